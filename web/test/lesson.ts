// Pages and viewers of a lesson with one teacher and two learners.

// @ts-expect-error ws has no type declarations
import { WebSocket as Socket } from "ws";
import type { State } from "../src/protocol/messages.js";
import { openPage, tokenFile, type TestPage } from "./page.js";

export const TOKENS = {
  teacher: "teacher-token-0123456789",
  L041: "first-token-012345678901",
  L042: "second-token-01234567890",
};
const LINES = `teacher ${TOKENS.teacher}\nlearner ${TOKENS.L041} L041\nlearner ${TOKENS.L042} L042\n`;

/** Opens a page of a lesson that waits for a token. */
export const openLesson = (): Promise<TestPage> =>
  openPage(
    ["--input", "pointer", "--task", "yes", "--token-file", tokenFile(LINES)],
    (page) => page.byId<HTMLDialogElement & HTMLInputElement>("token-dialog").open,
  );
export async function signIn(page: TestPage, token: string): Promise<void> {
  page.byId("token").value = token;
  page.byId<HTMLDialogElement & HTMLInputElement>("token-dialog").open = false;
  page.byId("token-form").dispatchEvent(new Event("submit", { cancelable: true }));
  await page.wait("the page is loaded", () => page.isLoaded());
}

/** Viewer without a page. */
export class Viewer {
  state: State | null = null; // latest state; null: none yet
  private readonly socket: Socket;

  constructor(page: TestPage, token: string) {
    this.socket = new Socket(`${page.server.url.replace("http", "ws")}ws`, "palpate.v1");
    this.socket.on("open", () => this.ask({ type: "hello", protocol: 3, token }));
    this.socket.on("message", (data: unknown, isBinary: boolean) => {
      const message = isBinary ? {} : JSON.parse(String(data));
      if (message.type === "state") this.state = message as State;
    });
  }
  ask(request: object): void {
    this.socket.send(JSON.stringify({ id: 1, ...request }));
  }
  close(): void {
    this.socket.close();
  }
}
