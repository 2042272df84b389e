// How the page reaches palpate: a server by HTTP and WebSocket, or a worker of this page.

/** The part of a WebSocket that the page uses. */
export interface Socket {
  binaryType: string;
  readonly readyState: number;
  onopen: ((event: Event) => void) | null;
  onmessage: ((event: MessageEvent) => void) | null;
  onclose: ((event: CloseEvent) => void) | null;
  send(text: string): void;
  close(): void;
}

export interface Transport {
  /** Requests a path of docs/reference/viewer-http.md. */
  get(path: string, token: string | null): Promise<Response>;
  open(): Socket;
}

const server: Transport = {
  get: (path, token) => fetch(path, token ? { headers: { Authorization: `Bearer ${token}` } } : {}),
  open: () => {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    return new WebSocket(`${scheme}://${location.host}/ws`, "palpate.v1") as Socket;
  },
};

let current = server;

export function transport(): Transport {
  return current;
}
/** Replaces the server; before the page starts. */
export function setTransport(other: Transport): void {
  current = other;
}
