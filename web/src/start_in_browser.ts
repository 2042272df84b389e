// Entry point of the page without a server: a choice of scenes or of the user's own files, and a worker that runs the
// session on them.

import { byId, element, write } from "./base/dom.js";
import { applyTheme } from "./panels/theme.js";
import { setTransport } from "./protocol/transport.js";
import { hideInitially } from "./state/appearance.js";
import { applyLanguage } from "./words/language.js";
import { IN_BROWSER } from "./words/in_browser.js";
import type { Language } from "./words/words.js";
import { CONTENTS, type Contents, type OwnFiles } from "./worker/messages.js";
import { WorkerTransport } from "./worker/worker_transport.js";

/** Phantoms by their name in the page's address, ?scene=NAME. */
const SCENES = {
  knee: "knee-phantom:spacing=1.5",
  lump: "palpation-block",
  gland: "gland-phantom:spacing=1",
  mastoid: "temporal-bone:spacing=0.6",
} as const;
type Scene = keyof typeof SCENES;

const isScene = (name: string | null): name is Scene => name !== null && Object.hasOwn(SCENES, name);

/** Texts in the page's language. */
const words = () => IN_BROWSER[document.documentElement.lang as Language];

/**
 * Shows the choice; resolves with the scene whose button is pressed, or with files that are picked or dropped.
 * @param problem  why the last choice could not be opened; empty: there was none
 */
function choose(problem: string): Promise<Scene | OwnFiles> {
  write(byId("cover-text"), problem ? words().failed(problem) : words().choose);
  return new Promise((done) => {
    const over = new AbortController(); // its listeners end with the choice
    const finish = (chosen: Scene | OwnFiles) => {
      over.abort();
      choices.remove();
      done(chosen);
    };
    const buttons = (Object.keys(SCENES) as Scene[]).map((scene) => {
      const button = element("button", { type: "button", className: "primary", textContent: words().scenes[scene] });
      button.onclick = () => finish(scene);
      return button;
    });

    const contents = element(
      "select",
      { id: "own-contents" },
      ...CONTENTS.map((one) => element("option", { value: one, textContent: words().contentsOf[one] })),
    );
    const take = (files: FileList | null | undefined) => {
      if (files?.length) finish({ files: [...files], contents: contents.value as Contents });
    };
    const picker = element("input", { id: "own-files", type: "file", multiple: true, hidden: true });
    picker.onchange = () => take(picker.files);
    const own = element("button", { id: "own", type: "button", textContent: words().own });
    own.onclick = () => picker.click();

    // files may be dropped anywhere on the page, which the browser would open in its place otherwise
    addEventListener("dragover", (event) => event.preventDefault(), { signal: over.signal });
    addEventListener(
      "drop",
      (event) => {
        event.preventDefault();
        take(event.dataTransfer?.files);
      },
      { signal: over.signal },
    );

    const choices = element(
      "div",
      { id: "scenes" },
      element("div", { className: "row" }, ...buttons, own, picker),
      element("p", { className: "quiet", textContent: words().ownAbout }),
      element("label", { className: "quiet" }, words().contents + " ", contents),
      element("p", { className: "quiet", textContent: words().stays }),
    );
    byId("cover-text").after(choices);
  });
}

/** Shows what the worker does while it opens a scene. */
function showProgress(stage: string, share: number): void {
  write(byId("cover-text"), stage === "reading" ? words().reading : words().preparing);
  const bar = byId<HTMLProgressElement>("cover-share");
  bar.hidden = false;
  bar.value = share;
}

/** Opens a choice in a worker of its own. Returns why it cannot be opened; empty: the session runs. */
async function open(chosen: Scene | OwnFiles): Promise<string> {
  write(byId("cover-text"), words().preparing);
  const worker = new Worker(new URL("./worker/palpate_worker.ts", import.meta.url), { type: "module" });
  try {
    const scene = typeof chosen === "string" ? SCENES[chosen] : chosen;
    setTransport(await WorkerTransport.open(worker, scene, showProgress));
    return "";
  } catch (error) {
    worker.terminate();
    return (error as Error).message;
  } finally {
    byId("cover-share").hidden = true;
  }
}

async function start(): Promise<void> {
  applyTheme();
  await applyLanguage();
  const address = new URL(location.href);
  const named = address.searchParams.get("scene");
  let chosen = isScene(named) ? named : await choose("");
  for (let problem = await open(chosen); problem; problem = await open(chosen)) chosen = await choose(problem);
  if (typeof chosen === "string") address.searchParams.set("scene", chosen);
  else address.searchParams.delete("scene");
  history.replaceState(null, "", address);
  if (chosen === "lump") hideInitially("nodule");
  await import("./main.js");
}
void start();
