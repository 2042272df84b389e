// Messages between the page and the worker in which palpate.wasm runs a session.

/** Content of a volume on its own: found by its values, or as the user says. */
export const CONTENTS = ["values", "labels", "scan"] as const;
export type Contents = (typeof CONTENTS)[number];

/** Files of the user: a label map, a scan or both, a table of names, and data files that these name. */
export interface OwnFiles {
  files: File[];
  contents: Contents;
}

/** From the page. `socket` numbers the connections that the page opens; messages of an earlier one are void. */
export type ToWorker =
  | { type: "open"; scene: string }
  | { type: "openFiles"; own: OwnFiles }
  | { type: "get"; id: number; path: string }
  | { type: "connect"; socket: number }
  | { type: "send"; socket: number; text: string }
  | { type: "disconnect"; socket: number };

/** From the worker. */
export type FromWorker =
  | { type: "progress"; stage: string; share: number } // while a scene is opened; part of the stage that is done
  | { type: "opened"; problem: string } // empty: the session runs
  | { type: "answer"; id: number; status: number; body: ArrayBuffer }
  | { type: "received"; socket: number; data: string | ArrayBuffer }
  | { type: "closed"; socket: number; code: number }
  | { type: "died"; why: string };
