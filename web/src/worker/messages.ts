// Messages between the page and the worker in which palpate.wasm runs a session.

/** From the page. `socket` numbers the connections that the page opens; messages of an earlier one are void. */
export type ToWorker =
  | { type: "open"; scene: string }
  | { type: "get"; id: number; path: string }
  | { type: "connect"; socket: number }
  | { type: "send"; socket: number; text: string }
  | { type: "disconnect"; socket: number };

/** From the worker. */
export type FromWorker =
  | { type: "opened"; problem: string } // empty: the session runs
  | { type: "answer"; id: number; status: number; body: ArrayBuffer }
  | { type: "received"; socket: number; data: string | ArrayBuffer }
  | { type: "closed"; socket: number; code: number }
  | { type: "died"; why: string };
