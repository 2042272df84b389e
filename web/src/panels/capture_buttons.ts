// Buttons for screenshots and videos, whose module is loaded on first use.

import { showError } from "../base/announce.js";
import { byId, press, write } from "../base/dom.js";
import { download, fileStem } from "../base/download.js";
import type { Picture } from "../drawing/picture.js";
import type { Session } from "../state/session.js";
import { LazyModule } from "../words/lazy_module.js";
import { words } from "../words/words.js";

export class CaptureButtons {
  readonly capture = new LazyModule("capture", async () => {
    const { Capture } = await import("./capture.js");
    return new Capture(this.session, this.pictures, byId("pictures"), this.isRedrawn, (error) => {
      showError(error);
      press(byId("record"), false);
    });
  });

  constructor(
    private readonly session: Session,
    private readonly pictures: Picture[],
    private readonly isRedrawn: () => boolean,
  ) {
    byId("shot").addEventListener("click", () => void this.screenshot());
    byId("record").addEventListener("click", () => void this.record());
    session.onFigures(() => {
      const capture = this.capture.value;
      write(byId("record"), capture?.isRecording ? words.recording(`${capture.seconds().toFixed(0)} s`) : words.record);
    });
  }

  async screenshot(): Promise<void> {
    const capture = await this.capture.get();
    await capture
      ?.screenshot()
      .then((blob) => download(blob, `${fileStem()}.png`))
      .catch(showError);
  }
  /** Begins or ends a video. */
  async record(): Promise<void> {
    const capture = await this.capture.get();
    if (!capture) return;
    try {
      if (capture.isRecording) capture.stop();
      else capture.start();
    } catch (error) {
      showError(error);
    }
    press(byId("record"), capture.isRecording);
  }
}
