// Loading of the scene and its volumes, with the cover that reports progress and problems, and the token.

import { batch } from "@preact/signals-core";
import { toast } from "../base/announce.js";
import { byId, write } from "../base/dom.js";
import { memory_GB } from "../base/screen.js";
import type { Connection } from "../protocol/connection.js";
import type { Scene } from "../protocol/messages.js";
import { fetchScene, fetchVolumes, NeedsToken, showsTheSame, shrinkFor } from "../protocol/scene.js";
import type { AnySlicer } from "../section/slicer.js";
import type { Session } from "../state/session.js";
import { VolumeNotFound, isMemoryShort, PermanentError } from "../words/errors.js";
import { words } from "../words/words.js";

const TOKEN_KEY = "palpate.token";
/** Delay of the first and maximum delay of further attempts to load. */
const FIRST_RETRY_MS = 500,
  MAX_RETRY_MS = 5000;

export interface LoadingContext {
  session: Session;
  slicer: AnySlicer;
  connection: Connection;
  /** Loads what the page needs before it shows a scene. */
  prepare(scene: Scene): Promise<unknown>;
  /** Called after the volumes of another scene are loaded. */
  onVolumes(): void;
}

export class Loading {
  token = sessionStorage.getItem(TOKEN_KEY);
  private context!: LoadingContext;
  private loading: Promise<void> | null = null;
  private isOutdated = false; // the scene may be another one than when loading began
  private isDiagnosing = false;

  begin(context: LoadingContext): Promise<void> {
    this.context = context;
    return this.load();
  }
  /** Loads the scene again, after an event that may have changed it; one load at a time. */
  reload(): void {
    this.isOutdated = true;
    void this.load();
  }
  /**
   * Loads the scene, and its volumes unless they are loaded already; one load at a time.
   * @param permanent  problem to report first
   */
  private load(permanent: PermanentError | null = null): Promise<void> {
    return (this.loading ??= this.loadAll(permanent).finally(() => (this.loading = null)));
  }
  private async loadAll(permanent: PermanentError | null): Promise<void> {
    if (permanent) await this.report(permanent);
    let missingHash = ""; // hash of a volume that was missing at the previous attempt
    for (let tried = 0; ; tried++) {
      try {
        await this.loadOnce();
        if (!this.isOutdated) break;
      } catch (error) {
        if (error instanceof NeedsToken) await this.promptForToken(this.token !== null);
        else if (error instanceof PermanentError) await this.report(error);
        else if (error instanceof VolumeNotFound && missingHash === error.message)
          await this.report(new PermanentError(words.lacksItsVolume(missingHash), words.startAgain));
        else {
          if (error instanceof VolumeNotFound) missingHash = error.message;
          write(byId("cover-text"), words.failedAgain((error as Error).message));
          await new Promise((later) => setTimeout(later, Math.min(FIRST_RETRY_MS * 2 ** tried, MAX_RETRY_MS)));
        }
      }
    }
    byId("cover").hidden = true;
  }
  private async loadOnce(): Promise<void> {
    const { session, connection, prepare } = this.context;
    this.isOutdated = false;
    const scene = await fetchScene(this.token);
    if (connection.link.value === "ended" || connection.link.value === "refused") connection.open();
    await prepare(scene);
    const volumes = session.volumes.value;
    if (volumes && showsTheSame(scene, session.scene.value)) session.setScene(scene, volumes);
    else await this.loadVolumes(scene);
  }

  private async loadVolumes(scene: Scene): Promise<void> {
    const { session, slicer, onVolumes } = this.context;
    byId("cover").hidden = false;
    write(byId("cover-text"), words.loading);
    this.showProgress(0);
    const memory = memory_GB();
    let shrink = shrinkFor(scene.volume.dims, {
      maxSide: slicer.maxSide,
      maxTexels: memory <= 2 ? 8e6 : memory <= 4 ? 32e6 : 256e6,
    });
    for (;;) {
      try {
        const volumes = await fetchVolumes(scene, shrink, this.token, (fraction) => this.showProgress(fraction));
        await slicer.load(volumes);
        // panels follow the scene after all that belongs to another patient is gone
        batch(() => {
          session.setScene(scene, volumes);
          onVolumes();
        });
        break;
      } catch (error) {
        if (!isMemoryShort(error) || slicer.isLost) throw error;
        if (shrink === 4) throw new PermanentError(words.noMemory, words.remedyMemory);
        shrink = shrink === 1 ? 2 : 4;
      }
    }
    if (shrink > 1) toast(words.shrunk(`1/${shrink}`));
  }
  private showProgress(fraction: number): void {
    const bar = byId<HTMLProgressElement>("cover-share");
    bar.value = fraction;
    bar.hidden = fraction >= 1;
  }

  /** Shows a problem and its remedy; resolves when the user requests a retry. */
  private report(permanent: PermanentError): Promise<void> {
    byId("cover").hidden = false;
    byId("cover-share").hidden = true;
    write(byId("cover-text"), `${permanent.message} ${permanent.remedy}`);
    byId("remedy").hidden = false;
    return new Promise((again) => {
      byId("again").onclick = () => {
        byId("remedy").hidden = true;
        write(byId("cover-text"), words.again);
        again();
      };
    });
  }
  /**
   * Handles a failed connection: a request for the scene shows whether and why the failure is permanent.
   * @param known  permanent problem, if already known
   */
  async diagnoseDisconnect(known: PermanentError | null): Promise<void> {
    // a pending check covers all failed attempts
    if (this.isDiagnosing && !known) return;
    this.isDiagnosing = true;
    await this.loading;
    this.isDiagnosing = false;
    const permanent = await fetchScene(this.token).then(
      () => known,
      (error) => (error instanceof PermanentError ? error : known),
    );
    const { connection } = this.context;
    if (!permanent || this.loading || connection.link.value === "connected") return;
    connection.end();
    await this.load(permanent);
  }

  private promptForToken(wasWrong: boolean): Promise<void> {
    const dialog = byId<HTMLDialogElement>("token-dialog");
    const input = byId<HTMLInputElement>("token");
    byId("token-problem").hidden = !wasWrong;
    byId("cover").hidden = true;
    input.value = "";
    if (!dialog.open) dialog.showModal();
    return new Promise((done) => {
      let isGiven = false;
      // Escape closes the dialog; it has to stay open until a token is entered
      dialog.onclose = () => {
        if (!isGiven && !dialog.open) dialog.showModal();
      };
      byId<HTMLFormElement>("token-form").onsubmit = () => {
        isGiven = true;
        this.token = input.value.trim();
        sessionStorage.setItem(TOKEN_KEY, this.token);
        this.context.connection.setToken(this.token);
        input.value = "";
        done();
      };
    });
  }
  /** Asks for another token after a connection was refused. */
  async requestToken(): Promise<void> {
    // a download may be asking for the token already
    await this.loading;
    await this.load();
  }
}
