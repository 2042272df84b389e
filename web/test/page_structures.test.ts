import assert from "node:assert/strict";
import test from "node:test";
import { openPage, testsOf } from "./page.js";

const page = await openPage(["--more", "108"]);
const { scene } = page.viewer;
const nameOf = (name: string): string => name.replaceAll("_", " ");
const names: string[] = scene.structures.map(({ name }: { name: string }) => nameOf(name));
const tissueOf = new Map<string, string>(
  scene.structures.map(({ name, tissue }: { name: string; tissue: number }) => [
    nameOf(name),
    scene.tissues[tissue].name,
  ]),
);
const lineName = (line: HTMLElement): string => line.querySelector(".name")!.textContent!;
const isShown = (line: HTMLElement): boolean => line.querySelector(".eye")!.textContent === "Shown";
const listed = () => page.shown(".structure").map(lineName);
const visible = () => page.all(".structure").filter(isShown).map(lineName);
const opacities = () =>
  page
    .all(".structure")
    .map(
      (line) =>
        [
          lineName(line),
          isShown(line) ? Number(line.querySelector<HTMLInputElement>("input[type=range]")!.value) : 0,
        ] as const,
    );
const group = (name: string) => page.all(".tissue").find((one) => one.querySelector(".title")!.textContent === name)!;
const find = (wanted: string) => page.set("#find", wanted, "input");
const sorted = (list: string[]) => [...list].sort();

testsOf(page, "the page", () => {
  test("limitations of the model are listed above the structures", () => {
    assert.deepEqual(
      page.shown("#caveats li").map(({ textContent }) => textContent),
      scene.caveats.map(({ text }: { text: string }) => text),
    );
    assert.equal(scene.caveats.length, 1);
  });

  test("structures are found by words of their names and shown in isolation", () => {
    find("menis LAT");
    assert.deepEqual(listed(), ["lateral meniscus"]);
    find("no such thing");
    assert.deepEqual(listed(), []);
    assert.equal(page.byId("none-found").hidden, false);
    find("");
    assert.deepEqual(sorted(listed()), sorted(names));
    // shows one structure alone, then another one, then the initial visibility
    const press = (name: string) => page.click(page.all(".structure .name").find((one) => one.textContent === name)!);
    page.click(page.all(".structure .eye")[0]!);
    const before = visible();
    assert.equal(before.length, names.length - 1);
    press("fibula");
    assert.deepEqual(visible(), ["fibula"]);
    press("patella");
    assert.deepEqual(visible(), ["patella"]);
    press("patella");
    assert.deepEqual(visible(), before);
    page.click("#hide-all");
    assert.deepEqual(visible(), []);
    page.click("#show-all");
    assert.deepEqual(sorted(visible()), sorted(names));
  });

  test("groups fold and toggle together, presets are undo steps, and keys move between lines", async () => {
    assert.equal(names.length, 116);
    const asItCame = opacities();
    const hidden = () =>
      new Set(
        opacities()
          .filter(([, opacity]) => opacity === 0)
          .map(([name]) => name),
      );
    const ofTissue = (is: (tissue: string) => boolean) => new Set(names.filter((name) => is(tissueOf.get(name)!)));
    const eye = group("bone").querySelector<HTMLElement>(".head .eye")!;
    page.click(eye);
    assert.deepEqual(
      hidden(),
      ofTissue((tissue) => tissue === "bone"),
    );
    page.click(".structure .eye");
    assert.deepEqual([eye.getAttribute("aria-pressed"), eye.textContent], ["mixed", "Partly"]);
    page.click(eye);
    assert.deepEqual(opacities(), asItCame);

    const presets: [string, (tissue: string) => number][] = [
      ["bone", (tissue) => Number(tissue === "bone")],
      ["translucent", (tissue) => (tissue === "bone" ? 1 : 0.3)],
      ["solid", () => 1],
    ];
    for (const [name, opacityOf] of presets) {
      page.set("#looks", name);
      for (const [structure, opacity] of opacities())
        assert.equal(opacity, opacityOf(tissueOf.get(structure)!), `${name}: ${structure}`);
    }
    for (const _ of [1, 2]) {
      page.click("#undo");
      await page.settle();
    }
    assert.deepEqual(
      hidden(),
      ofTissue((tissue) => tissue !== "bone"),
    );
    page.set("#looks", "scene");
    assert.deepEqual(opacities(), asItCame);

    // a search finds structures of folded groups
    page.click(group("bone").querySelector<HTMLElement>(".fold")!);
    assert.deepEqual(
      new Set(listed()),
      ofTissue((tissue) => tissue !== "bone"),
    );
    find("femur");
    assert.deepEqual(listed(), ["femur"]);
    find("");
    page.click(group("bone").querySelector<HTMLElement>(".fold")!);

    const order = listed();
    page.all(".structure .eye")[0]!.focus();
    for (const [key, place] of [
      ["ArrowDown", 1],
      ["End", 115],
      ["ArrowUp", 114],
      ["PageUp", 104],
      ["Home", 0],
    ] as const) {
      page.key(key, {}, document.activeElement!);
      assert.equal(lineName(document.activeElement!.closest<HTMLElement>(".structure")!), order[place], key);
    }
    assert.equal(document.activeElement!.className, "eye");
    // one row of four controls is in the tab order
    assert.equal(page.all(".structure button, .structure input").filter((one) => one.tabIndex !== -1).length, 4);
  });

  test("changes are undone, but neither a pause nor a stop", async () => {
    const stiffness = () => page.viewer.state.tissues[0].stiffness_N_per_mm as number;
    const isAt = (wanted: number) =>
      page.wait(`a stiffness of ${wanted}`, () => Math.abs(stiffness() / wanted - 1) < 0.01);
    const before = stiffness();
    page.byId("find").dispatchEvent(new Event("change", { bubbles: true }));
    for (const place of [0.5, 0.6]) {
      page.set("input[data-tissue='0']", place, "input");
      await isAt(0.01 * 1000 ** place);
    }
    const eye = page.all(".structure .eye")[0]!;
    page.click(eye);
    assert.equal(eye.textContent, "Hidden");
    page.click("#pause");
    await page.wait("paused", () => page.viewer.state.paused);
    // the space bar is the emergency stop in number fields, too
    page.key(" ", {}, page.byId("level"));
    await page.wait("stopped", () => page.viewer.state.emergency_stop);
    const undo = () => page.key("z", { ctrlKey: true });
    undo();
    await page.settle();
    assert.equal(eye.textContent, "Shown");
    undo();
    await isAt(before);
    page.key("Z", { ctrlKey: true, shiftKey: true });
    await isAt(0.01 * 1000 ** 0.6);
    page.click("#undo");
    await isAt(before);
    assert.ok(page.viewer.state.paused && page.viewer.state.emergency_stop);
    page.click("#pause");
    await page.wait("it goes on", () => !page.viewer.state.paused && !page.byId("rearm").disabled);
    page.click("#rearm");
    await page.wait("rearmed", () => !page.viewer.state.emergency_stop);
  });

  test("small forces and depths have three digits", async () => {
    // minimum of the sliders: 0.01 N/mm
    for (const place of scene.tissues.keys()) page.set(`input[data-tissue='${place}']`, 0, "input");
    await page.wait("all tissue is soft", () =>
      page.viewer.state.tissues.every(
        ({ stiffness_N_per_mm }: { stiffness_N_per_mm: number }) => stiffness_N_per_mm === 0.01,
      ),
    );
    await page.wait("the loop's too", () => page.viewer.pose.devices[0].stiffness === Math.fround(0.01));
    for (let n = 0; n < 10; n++) {
      const { sequence } = page.viewer.pose;
      const force = () => Math.hypot(...page.viewer.pose.devices[0].force);
      await page.wait(
        "another touch",
        () => page.viewer.pose.sequence > sequence && force() > 0 && Number.isFinite(page.viewer.pose.devices[0].depth),
      );
      page.draw();
      const factor = { N: 1, mN: 1e-3, mm: 1, µm: 1e-3 } as Record<string, number>;
      const isClose = (text: string, unit: string, value: number) =>
        assert.ok(
          Math.abs((Number(text.replace("−", "-")) * factor[unit]!) / value - 1) <= 0.006,
          `${text} ${unit} of ${value}`,
        );
      isClose(page.text("force"), page.text("force-unit"), force());
      const [depth, unit] = page.text("depth").split(" ") as [string, string];
      isClose(depth, unit, page.viewer.pose.devices[0].depth);
    }
  });

  test("figures of the servo loop are updated in a card that is closed at first", async () => {
    const card = page.byId("servo-card") as HTMLDetailsElement;
    assert.equal(card.open, false);
    await page.wait("figures of the loop", () => /^\d+ Hz · /.test(card.querySelector("#loop")!.textContent!));
    assert.equal(card.contains(page.byId("plot-late-value")), true);
    assert.equal(card.contains(page.byId("plot-force-value")), false);
  });

  test("help opens and closes by key and button, and single-key shortcuts can be disabled", () => {
    const isHidden = () => page.byId("help-box").hidden;
    const tool = () => document.querySelector<HTMLElement>("[data-tool][aria-checked=true]")!.dataset.tool;
    assert.ok(isHidden());
    page.key("?");
    assert.ok(!isHidden());
    page.key("Escape");
    assert.ok(isHidden());
    page.click("#help");
    assert.ok(!isHidden());
    page.key("r");
    assert.equal(tool(), "ruler");
    page.click("#letters");
    page.key("a");
    assert.equal(tool(), "ruler");
    page.click("#letters");
    page.key("a");
    assert.equal(tool(), "angle");
    page.click("#help-close");
    assert.ok(isHidden());
  });

  test("the scope view is created when a layout first shows it", async () => {
    assert.equal(document.getElementById("picture-scope"), null);
    page.key("6");
    assert.ok(page.byId("pictures").classList.contains("layout-scope"));
    assert.equal(page.all("[data-layout][aria-checked=true]")[0]!.dataset.layout, "scope");
    await page.wait("the scope view", () => document.getElementById("picture-scope"));
    page.click("[data-layout=two]");
    assert.ok(page.byId("pictures").classList.contains("layout-two"));
  });
});
