// Panel of a lesson: identity of the learner, permitted task, names hidden by a quiz, and learning curves.

import { effect } from "@preact/signals-core";
import { toast } from "../base/announce.js";
import type { Scene } from "../protocol/messages.js";
import type { Connection } from "../protocol/connection.js";
import { byId, write } from "../base/dom.js";
import type { Requests } from "../state/requests.js";
import type { Session } from "../state/session.js";
import { says, words } from "../words/words.js";

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
const SURE_MS = 4000;

export class Lesson {
  private endAsked_ms = -Infinity;

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
    requests: Requests,
    private readonly token: () => string | null,
  ) {
    const ask = (asked: Record<string, unknown>) => void requests.once({ type: "lesson", ...asked });
    const learner = byId<HTMLInputElement>("lesson-learner");
    learner.addEventListener("change", () => ask({ learner: learner.value.trim() }));
    byId("lesson-task").addEventListener("change", (event) => ask({ task: (event.target as HTMLSelectElement).value }));
    byId("lesson-names").addEventListener("change", (event) =>
      ask({ names: (event.target as HTMLInputElement).checked }),
    );
    byId("lesson-end").addEventListener("click", () => {
      // a second press instead of a modal dialog, which would block the emergency stop
      const isSure = performance.now() - this.endAsked_ms < SURE_MS;
      this.endAsked_ms = isSure ? -Infinity : performance.now();
      if (isSure) ask({ end: true });
      says(byId("lesson-end"), { text: isSure ? "endSession" : "endSessionAsked" });
      if (!isSure) setTimeout(() => says(byId("lesson-end"), { text: "endSession" }), SURE_MS);
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
    effect(() => this.showLesson());
  }

  /** Shows the identity of this viewer, and the controls that its permissions allow. */
  private showViewer(): void {
    const { connection } = this;
    const role = connection.role.value,
      learner = connection.learner.value;
    const isLed = connection.allows("lesson"),
      seesRuns = connection.allows("own_runs") || connection.allows("all_runs");
    const said =
      role === "learner" ? words.youAreLearner(learner ?? "") : role === "teacher" ? words.youAreTeacher : "";
    write(byId("who"), said);
    byId("who").hidden = said === "";
    byId("lesson").hidden = !isLed && role !== "learner";
    byId("lesson-led").hidden = !isLed;
    byId("curves-show").hidden = !seesRuns;
    says(byId("curves-show"), { text: connection.allows("all_runs") ? "allCurves" : "ownCurves" });
  }
  private showLesson(): void {
    const lesson = this.session.state.value?.lesson;
    if (!lesson) return;
    write(
      byId("lesson-note"),
      this.connection.allows("lesson")
        ? lesson.learner === null
          ? words.lessonOfNobody
          : words.lessonOf(lesson.learner)
        : lesson.of_another
          ? words.lessonOfAnother
          : lesson.veiled
            ? words.lessonVeiled
            : words.lessonYours,
    );
    const input = byId<HTMLInputElement>("lesson-learner");
    if (document.activeElement !== input) input.value = lesson.learner ?? "";
    byId<HTMLSelectElement>("lesson-task").value = lesson.task ?? "";
    byId<HTMLInputElement>("lesson-names").checked = lesson.names;
  }
  private listTasks({ tasks }: Scene): void {
    byId("lesson-task").replaceChildren(
      says(new Option("", ""), { text: "anyTask" }),
      ...(tasks ?? []).map(({ name, title }) => new Option(title, name)),
    );
    byId("lesson-task-line").hidden = (tasks ?? []).length < 2;
  }

  private async showCurves(): Promise<void> {
    const token = this.token();
    try {
      const answer = await fetch("/api/curves", token ? { headers: { Authorization: `Bearer ${token}` } } : {});
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
