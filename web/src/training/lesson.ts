// Lesson panel: the learner's turn, the owner of the tip, the permitted task, names hidden by a quiz, and
// learning curves.

import { effect } from "@preact/signals-core";
import { toast } from "../base/announce.js";
import type { LessonLearner, Scene, State } from "../protocol/messages.js";
import type { Connection } from "../protocol/connection.js";
import { transport } from "../protocol/transport.js";
import { byId, element, press, write } from "../base/dom.js";
import type { Requests } from "../state/requests.js";
import type { Session } from "../state/session.js";
import { setMessages, words } from "../words/words.js";

/** Shows an HTML page made by palpate inside this one, isolated with its own styles. Scripts in it are not executed. */
function showPage(host: HTMLElement, html: string): void {
  // constructed style sheets, because the content security policy forbids inline styles in parsed documents
  let rules = "";
  const body = html.replace(/<style>([\s\S]*?)<\/style>/g, (_, its: string) => {
    rules += its;
    return "";
  });
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(rules);
  const main = new DOMParser().parseFromString(body, "text/html").querySelector("main");
  const shadow = host.shadowRoot ?? host.attachShadow({ mode: "open" });
  shadow.adoptedStyleSheets = [sheet];
  shadow.replaceChildren(...(main ? [...main.childNodes].map((node) => document.importNode(node, true)) : []));
}

/** Time within which a second press confirms the end of the session. */
const CONFIRMATION_MS = 10_000;

/** Row of the list of learners. */
interface LearnerRow {
  turn: HTMLButtonElement; // gives the turn to the learner
  status: HTMLElement;
  pass: HTMLButtonElement; // passes the tip to the learner
}

export class Lesson {
  private endConfirmation: number | null = null; // timer while a second press would end the session
  private anyone: HTMLButtonElement | null = null; // gives the turn to no particular learner
  private rows = new Map<string, LearnerRow>(); // rows of the list by pseudonym

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
    private readonly requests: Requests,
    private readonly token: () => string | null,
  ) {
    const send = (request: Record<string, unknown>) => void this.send(request);
    const learner = byId<HTMLInputElement>("lesson-learner");
    learner.addEventListener("change", () => send({ learner: learner.value.trim() }));
    byId("lesson-take").addEventListener("click", () => void this.claimTip());
    byId("lesson-task").addEventListener("change", (event) =>
      send({ task: (event.target as HTMLSelectElement).value }),
    );
    byId("lesson-names").addEventListener("change", (event) =>
      send({ names: (event.target as HTMLInputElement).checked }),
    );
    byId("lesson-end").addEventListener("click", () => {
      // a second press instead of a modal dialog, which would block the emergency stop
      if (this.endConfirmation !== null) {
        this.withdrawEnd();
        send({ end: true });
        return;
      }
      setMessages(byId("lesson-end"), { text: "endSessionAsked" });
      this.endConfirmation = window.setTimeout(() => this.withdrawEnd(), CONFIRMATION_MS);
    });
    byId("curves-show").addEventListener("click", () => void this.showCurves());
    byId("curves-close").addEventListener("click", () => this.closeCurves());
    byId("curves").addEventListener("keydown", (event) => {
      if ((event as KeyboardEvent).key === "Escape") this.closeCurves();
    });
    effect(() => this.showViewer());
    session.onScene((scene) => {
      this.listTasks(scene);
      this.showLesson();
    });
    effect(() => {
      void requests.refusals.value;
      this.showLesson();
    });
  }

  private send(request: Record<string, unknown>): Promise<boolean> {
    return this.requests.once({ type: "lesson", ...request });
  }
  /** Asks for confirmation again before the session may end. */
  private withdrawEnd(): void {
    if (this.endConfirmation !== null) window.clearTimeout(this.endConfirmation);
    this.endConfirmation = null;
    setMessages(byId("lesson-end"), { text: "endSession" });
  }
  /** Takes the pointer from its holder, if there is one. */
  private async claimTip(): Promise<void> {
    const isByViewer = this.session.state.value?.pointer_by === "viewer";
    if (!isByViewer || (await this.send({ pointer: "" }))) void this.requests.once({ type: "pointer", take: true });
  }

  /** Shows the identity of this viewer, and the controls that its permissions allow. */
  private showViewer(): void {
    const { connection } = this;
    const role = connection.role.value,
      learner = connection.learner.value;
    const isLed = connection.allows("lesson"),
      seesRuns = connection.allows("own_runs") || connection.allows("all_runs");
    const text =
      role === "learner" ? words.youAreLearner(learner ?? "") : role === "teacher" ? words.youAreTeacher : "";
    write(byId("who"), text);
    byId("who").hidden = text === "";
    byId("lesson").hidden = !isLed && role !== "learner";
    byId("lesson-led").hidden = !isLed;
    byId("curves-show").hidden = !seesRuns;
    setMessages(byId("curves-show"), { text: connection.allows("all_runs") ? "allCurves" : "ownCurves" });
  }
  private showLesson(): void {
    const state = this.session.state.value;
    if (!state) return;
    const { lesson } = state;
    write(
      byId("lesson-note"),
      lesson.over
        ? words.lessonOver
        : this.connection.allows("lesson")
          ? lesson.learner === null
            ? words.lessonOfNobody
            : words.lessonOf(lesson.learner)
          : lesson.of_another
            ? words.lessonOfAnother
            : lesson.redacted
              ? words.lessonRedacted
              : words.lessonYours,
    );
    this.showLearners(state);
    this.showTip(state);
    const input = byId<HTMLInputElement>("lesson-learner");
    if (document.activeElement !== input) input.value = lesson.learner ?? "";
    byId<HTMLSelectElement>("lesson-task").value = lesson.task ?? "";
    byId<HTMLInputElement>("lesson-names").checked = lesson.names;
  }
  /** Whether a viewer of this session moves the tip. */
  private get hasPointer(): boolean {
    return this.session.scene.value?.device.input === "pointer";
  }
  /** Shows the learners with a token; without any, a field for a pseudonym. */
  private showLearners({ lesson }: State): void {
    const learners = lesson.learners ?? [];
    byId("lesson-learners").hidden = learners.length === 0;
    byId("lesson-learner-line").hidden = learners.length > 0;
    if (learners.length !== this.rows.size || learners.some(({ learner }) => !this.rows.has(learner)))
      this.listLearners(learners);
    if (this.anyone) press(this.anyone, lesson.learner === null);
    for (const { learner, here, pointer } of learners) {
      const { turn, status, pass } = this.rows.get(learner)!;
      press(turn, lesson.learner === learner);
      setMessages(status, { text: pointer ? "movesTip" : here ? "isHere" : "isAway" });
      pass.hidden = !this.hasPointer;
      pass.disabled = !here || pointer || (lesson.learner !== null && lesson.learner !== learner);
    }
  }
  private listLearners(learners: LessonLearner[]): void {
    const turnOf = (learner: string) => {
      const turn = element("button", { type: "button", className: "name" });
      turn.dataset.learner = learner;
      turn.addEventListener("click", () => void this.send({ learner }));
      return turn;
    };
    this.anyone = setMessages(turnOf(""), { text: "anyone", title: "anyoneTitle" });
    this.rows = new Map(
      learners.map(({ learner }) => {
        const turn = setMessages(turnOf(learner), { title: "nextTurn" }, learner);
        turn.textContent = learner;
        const pass = setMessages(
          element("button", { type: "button" }),
          { text: "passTip", label: "passTipTo" },
          learner,
        );
        pass.addEventListener("click", () => void this.send({ pointer: learner }));
        return [learner, { turn, status: element("span", { className: "quiet" }), pass }];
      }),
    );
    byId("lesson-learners").replaceChildren(
      element("div", {}, this.anyone),
      ...[...this.rows.values()].map(({ turn, status, pass }) => element("div", {}, turn, status, pass)),
    );
  }
  /** Shows who moves the tip. */
  private showTip({ lesson, pointer_by }: State): void {
    const holder = lesson.learners?.find(({ pointer }) => pointer);
    byId("lesson-tip").hidden = !this.hasPointer;
    write(
      byId("lesson-tip-text"),
      holder
        ? words.tipMovedBy(holder.learner)
        : pointer_by === "you"
          ? words.tipMovedByYou
          : pointer_by === "viewer"
            ? words.tipMovedByOther
            : words.tipFree,
    );
    byId<HTMLButtonElement>("lesson-take").disabled = pointer_by === "you";
  }
  private listTasks({ tasks }: Scene): void {
    byId("lesson-task").replaceChildren(
      setMessages(new Option("", ""), { text: "anyTask" }),
      ...(tasks ?? []).map(({ name, title }) => new Option(title, name)),
    );
    byId("lesson-task-line").hidden = (tasks ?? []).length < 2;
  }

  private async showCurves(): Promise<void> {
    const token = this.token();
    try {
      const answer = await transport().get("/api/curves", token);
      if (!answer.ok) return toast(words.noCurves(await answer.text()));
      showPage(byId("curves-page"), await answer.text());
    } catch (error) {
      return toast(words.noCurves((error as Error).message));
    }
    byId("curves").hidden = false;
    byId("curves").focus();
  }
  private closeCurves(): void {
    byId("curves").hidden = true;
    byId("curves-show").focus();
  }
}
