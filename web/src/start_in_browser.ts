// Entry point of the page without a server: a choice of scenes, and a worker that runs the session on the chosen one.

import { byId, element, write } from "./base/dom.js";
import { applyTheme } from "./panels/theme.js";
import { setTransport } from "./protocol/transport.js";
import { hideInitially } from "./state/appearance.js";
import { applyLanguage } from "./words/language.js";
import { IN_BROWSER } from "./words/in_browser.js";
import type { Language } from "./words/words.js";
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

/** Shows the choice; resolves with the scene whose button is pressed. */
function choose(): Promise<Scene> {
  write(byId("cover-text"), words().choose);
  return new Promise((done) => {
    const buttons = (Object.keys(SCENES) as Scene[]).map((scene) =>
      element("button", { type: "button", className: "primary", textContent: words().scenes[scene] }),
    );
    const row = element("div", { id: "scenes", className: "row" }, ...buttons);
    const note = element("p", { className: "quiet", textContent: words().stays });
    byId("cover-text").after(row, note);
    buttons.forEach((button, n) => {
      button.onclick = () => {
        row.remove();
        note.remove();
        done((Object.keys(SCENES) as Scene[])[n]!);
      };
    });
  });
}

async function start(): Promise<void> {
  applyTheme();
  await applyLanguage();
  const address = new URL(location.href);
  const named = address.searchParams.get("scene");
  const scene = isScene(named) ? named : await choose();
  address.searchParams.set("scene", scene);
  history.replaceState(null, "", address);
  write(byId("cover-text"), words().preparing);
  if (scene === "lump") hideInitially("nodule");
  const worker = new Worker(new URL("./worker/palpate_worker.ts", import.meta.url), { type: "module" });
  try {
    setTransport(await WorkerTransport.open(worker, SCENES[scene]));
  } catch (error) {
    return write(byId("cover-text"), words().failed((error as Error).message));
  }
  await import("./main.js");
}
void start();
