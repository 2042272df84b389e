// Panel of the plan: trajectories and their edits, deviation of the tool from the nearest one, distances to keep.

import { effect } from "@preact/signals-core";
import type { Trajectory } from "../protocol/messages.js";
import { announce, toast } from "../base/announce.js";
import { byId, element, write } from "../base/dom.js";
import { download, fileStem } from "../base/download.js";
import { digits, quantity } from "../words/figures.js";
import { rotate, type Vec3 } from "../base/geometry.js";
import type { Connection } from "../protocol/connection.js";
import { breachesOf, deviationFrom, planText, shaftOf, toTrajectory } from "../state/plan.js";
import type { End, PlanStore } from "../state/plan_store.js";
import type { Session } from "../state/session.js";
import type { DevicePose } from "../protocol/wire.js";
import { setMessages, words } from "../words/words.js";

/** Maximum distance from a trajectory at which deviations are displayed. */
const NEAR_MM = 40;
const ENDS: End[] = ["entry_mm", "target_mm"];

export class PlanPanel {
  private shown = ""; // key of the list's contents
  private spoken = ""; // breach announced last
  private wasThere = false; // whether a plan existed at the last update
  private firstOrientation = "";
  private reportsOrientation = false;

  /** @param moveTo  moves all planes to a position */
  constructor(
    private readonly session: Session,
    connection: Connection,
    private readonly moveTo: (position: Vec3) => void,
  ) {
    const { plans } = session;
    byId("plan-new").addEventListener(
      "click",
      () => session.volumes.value && plans.addTowards(session.anchor(), session.volumes.value.centre),
    );
    byId("plan-save").addEventListener(
      "click",
      () => void plans.save().then((isSaved) => isSaved && toast(words.planSaved)),
    );
    byId("plan-download").addEventListener(
      "click",
      () =>
        plans.plan &&
        download(
          new Blob([planText(plans.plan, words.planTitle)], { type: "application/toml" }),
          `${fileStem()}-plan.toml`,
        ),
    );
    effect(() => this.show());
    // another connection may have another device
    effect(() => {
      if (connection.link.value === "connected") [this.firstOrientation, this.reportsOrientation] = ["", false];
    });
    effect(() => this.watchOrientation(session.pose.value?.devices[0]));
    session.onFigures(() => this.draw());
  }
  private get plans(): PlanStore {
    return this.session.plans;
  }

  /** Detects orientation sensors: a device without them reports a constant orientation. */
  private watchOrientation(device: DevicePose | undefined): void {
    if (!device) return;
    const orientation = device.orientation.join();
    this.firstOrientation ||= orientation;
    this.reportsOrientation ||= orientation !== this.firstOrientation;
  }

  // ---- list

  private show(): void {
    const { plans } = this;
    const { plan } = plans;
    // opens the panel when a plan appears; the user may fold it
    if (plan && !this.wasThere) byId<HTMLDetailsElement>("plan-card").open = true;
    this.wasThere = plan !== null;
    byId("plan-none").hidden = plan !== null;
    write(
      byId("plan-note"),
      plans.isShared ? (plan!.saved ? words.planIsSaved : words.planNotSaved) : plans.isOwn ? words.planOwn : "",
    );
    byId("plan-save").hidden = !plans.isShared;
    byId<HTMLButtonElement>("plan-save").disabled = plan?.saved !== false;
    byId("plan-download").hidden = !plan;
    byId("plan-live").hidden = plans.list.length === 0;
    this.showList();
  }
  private showList(): void {
    const { plans } = this;
    const made = JSON.stringify([plans.list, plans.chosen.value, this.session.convention.value, words.plan]);
    if (made === this.shown) return;
    this.shown = made;
    // keeps the focus at its position in the list
    const focused = (document.activeElement as HTMLElement | null)?.dataset.plan;
    byId("plan-list").replaceChildren(...plans.list.map((one, index) => this.lineOf(one, index)));
    if (focused) (byId("plan-list").querySelector<HTMLElement>(`[data-plan="${focused}"]`) ?? byId("plan-new")).focus();
  }
  private lineOf(one: Trajectory, index: number): HTMLElement {
    const { plans } = this;
    const isChosen = index === plans.chosen.value;
    const name = setMessages(
      element("input", { type: "text", value: one.name, maxLength: 60, autocomplete: "off", spellcheck: false }),
      { label: "trajectoryName" },
    );
    name.addEventListener("change", () => plans.replace(index, { ...one, name: name.value }));
    const choose = setMessages(
      element("button", {
        type: "button",
        className: "figure",
        textContent: quantity(lengthOf(one), "mm"),
        ariaExpanded: String(isChosen),
      }),
      { title: "changeTrajectory", label: "changeTrajectory" },
      one.name,
    );
    choose.addEventListener("click", () => void (plans.chosen.value = isChosen ? -1 : index));
    const remove = setMessages(
      element("button", { type: "button", textContent: "×" }),
      { label: "deleteNamed", title: "deleteNamed" },
      one.name,
    );
    remove.addEventListener("click", () => plans.remove(index));
    for (const [control, of] of [
      [name, "name"],
      [choose, "choose"],
      [remove, "remove"],
    ] as const)
      control.dataset.plan = `${of}-${index}`;
    return element(
      "li",
      { className: isChosen ? "chosen" : "" },
      name,
      choose,
      remove,
      ...(isChosen ? ENDS.map((end) => this.endOf(one, index, end)) : []),
    );
  }
  /** Text field for a trajectory's end, in the displayed convention (LPS or RAS), mm. */
  private endOf(one: Trajectory, index: number, end: End): HTMLElement {
    const { session, plans } = this;
    const sign = session.convention.value === "RAS" ? -1 : 1;
    const turned = ([x, y, z]: Vec3): Vec3 => [sign * x, sign * y, z];
    const about = end === "entry_mm" ? "entryAt" : "targetAt";
    const at = setMessages(
      element("input", {
        type: "text",
        value: turned(one[end])
          .map((x) => Number(x.toFixed(2)))
          .join(", "),
        autocomplete: "off",
        spellcheck: false,
      }),
      { label: about },
    );
    at.addEventListener("change", () => {
      const numbers = at.value
        .split(/[\s,;]+/)
        .filter(Boolean)
        .map((x) => Number(x.replace("−", "-")));
      if (numbers.length === 3 && numbers.every(Number.isFinite))
        return plans.replace(index, { ...one, [end]: turned(numbers as Vec3) });
      toast(words.threeNumbers);
      this.shown = "";
      this.showList();
    });
    const here = setMessages(element("button", { type: "button" }), {
      text: "here",
      title: end === "entry_mm" ? "entryHere" : "targetHere",
    });
    here.addEventListener("click", () => plans.replace(index, { ...one, [end]: session.anchor() }));
    const show = setMessages(element("button", { type: "button" }), {
      text: "locate",
      title: end === "entry_mm" ? "showEntry" : "showTarget",
    });
    show.addEventListener("click", () => this.moveTo(one[end]));
    for (const [control, of] of [
      [at, "at"],
      [here, "here"],
      [show, "show"],
    ] as const)
      control.dataset.plan = `${of}-${end}-${index}`;
    return element(
      "div",
      { className: "end" },
      setMessages(element("span"), { text: end === "entry_mm" ? "entry" : "target" }),
      at,
      here,
      show,
    );
  }

  // ---- deviation of the tool

  private shaft(device: DevicePose): Vec3 | null {
    const { session } = this;
    const shaft = this.reportsOrientation ? shaftOf(session.toolOf(device)) : null;
    return shaft && session.toPatient(session.pose.value!, rotate(device.orientation, shaft));
  }
  private draw(): void {
    const { session, plans } = this;
    const device = session.pose.value?.devices[0];
    const { plan } = plans;
    if (!device || !plan || !session.scene.value) return;
    const [nearest] = plans.list
      .map((one) => ({ one, far: toTrajectory(one, device.tip) }))
      .sort((a, b) => a.far - b.far);
    const isTrajectoryNear = nearest !== undefined && nearest.far <= NEAR_MM;
    const deviation = isTrajectoryNear ? deviationFrom(nearest.one, device.tip, this.shaft(device)) : null;
    write(byId("plan-nearest"), isTrajectoryNear ? nearest.one.name : words.noTrajectoryNear(quantity(NEAR_MM, "mm")));
    write(byId("plan-lateral"), deviation ? quantity(deviation.lateral_mm, "mm") : "–");
    write(byId("plan-left"), deviation ? quantity(deviation.left_mm, "mm") : "–");
    write(byId("plan-angle"), deviation?.angle_deg == null ? "–" : `${digits(deviation.angle_deg)}°`);

    // structures that are closer than planned
    const breaches = breachesOf(plan, session.nearTo(device));
    const [worst] = breaches;
    const name = worst ? session.nameOf(worst.label) : "";
    write(
      byId("plan-breach"),
      worst ? `⚠ ${words.planBreach(name, quantity(worst.mm, "mm"), quantity(worst.requested_mm, "mm"))}` : "",
    );
    byId("plan-breach").hidden = !worst;
    if (name !== this.spoken && worst) announce(words.planBreachSpoken(name));
    this.spoken = name;
    // distances to keep cannot be checked if the scene reports no distances
    byId("plan-not-monitored").hidden = plan.keep_away.length === 0 || session.scene.value.distances !== null;
  }
}

const lengthOf = ({ entry_mm, target_mm }: Trajectory): number =>
  Math.hypot(...entry_mm.map((x, axis) => x - target_mm[axis]!));
