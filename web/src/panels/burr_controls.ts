// Controls of a session with a burr: its sound, and the switch of its vibration, which other sessions do not show.

import { effect } from "@preact/signals-core";
import { byId, element, press } from "../base/dom.js";
import type { Connection } from "../protocol/connection.js";
import type { Session } from "../state/session.js";
import { LazyModule } from "../words/lazy_module.js";
import { setMessages } from "../words/words.js";

export class BurrControls {
  constructor(session: Session, connection: Connection) {
    const sound = new LazyModule(
      "burrSound",
      async () => new (await import("./burr_sound.js")).BurrSound(session, connection),
    );
    const button = setMessages(element("button", { id: "burr-sound", type: "button" }), {
      text: "sound",
      title: "burrSound",
    });
    press(button, false);
    button.addEventListener("click", async () => {
      const burr = await sound.get();
      burr?.toggle();
      press(button, burr?.isOn === true);
    });
    byId("motor").after(button);
    effect(() => {
      const cuts = session.scene.value?.tools.some((tool) => tool.cuts) === true;
      button.hidden = byId("vibration").parentElement!.hidden = !cuts;
    });
  }
}
