// The functions of WASI (wasi_snapshot_preview1) that palpate.wasm imports: clock, random numbers, and texts on stderr.
// There are no files.

const OK = 0,
  BAD_DESCRIPTOR = 8,
  NOT_SUPPORTED = 58;

/** @param onText  called with each text that the program writes */
export function wasi(memory: () => WebAssembly.Memory, onText: (text: string) => void): WebAssembly.ModuleImports {
  const view = () => new DataView(memory().buffer);
  return {
    environ_sizes_get: (count: number, size: number) => {
      view().setUint32(count, 0, true);
      view().setUint32(size, 0, true);
      return OK;
    },
    environ_get: () => OK,
    clock_time_get: (clock: number, _precision: bigint, at: number) => {
      const REALTIME = 0;
      const now_ms = clock === REALTIME ? Date.now() : performance.now();
      view().setBigUint64(at, BigInt(Math.round(now_ms * 1e6)), true);
      return OK;
    },
    random_get: (at: number, length: number) => {
      crypto.getRandomValues(new Uint8Array(memory().buffer, at, length));
      return OK;
    },
    fd_write: (_file: number, pieces: number, count: number, written: number) => {
      let text = "";
      let length = 0;
      for (let n = 0; n < count; n++) {
        const from = view().getUint32(pieces + 8 * n, true);
        const bytes = view().getUint32(pieces + 8 * n + 4, true);
        text += new TextDecoder().decode(new Uint8Array(memory().buffer, from, bytes));
        length += bytes;
      }
      view().setUint32(written, length, true);
      onText(text);
      return OK;
    },
    fd_close: () => BAD_DESCRIPTOR,
    fd_seek: () => BAD_DESCRIPTOR,
    fd_fdstat_get: () => BAD_DESCRIPTOR,
    fd_prestat_get: () => BAD_DESCRIPTOR,
    fd_prestat_dir_name: () => BAD_DESCRIPTOR,
    // nothing sleeps in a worker: JavaScript wakes it
    poll_oneoff: () => NOT_SUPPORTED,
    proc_exit: (code: number) => {
      throw new Error(String(code));
    },
  };
}
