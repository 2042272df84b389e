// The functions of WASI (wasi_snapshot_preview1) that palpate.wasm imports: clock, random numbers, texts on stderr, and
// the files that the page was given, which are its only folder and cannot be written.

/** A file of the page's folder. */
export interface ReadableFile {
  readonly size: number; // bytes
  /** At most `count` bytes from `at` on; fewer only at the end. Throws if the file cannot be read any more. */
  read(at: number, count: number): Uint8Array;
}
/** The folder: files by their names. */
export type Folder = ReadonlyMap<string, ReadableFile>;

// error numbers and types of files, of wasi_snapshot_preview1
const OK = 0,
  BAD_DESCRIPTOR = 8,
  INVALID = 28,
  READING_FAILED = 29,
  NO_ENTRY = 44,
  NOT_A_DIRECTORY = 54,
  NOT_SUPPORTED = 58,
  READ_ONLY = 69;
const DIRECTORY = 3,
  REGULAR_FILE = 4;
const OPEN_CREATE = 1,
  OPEN_DIRECTORY = 2,
  OPEN_TRUNCATE = 8;

/** The descriptor by which a program finds the folder, and its name. */
const ROOT = 3,
  ROOT_NAME = "/";

interface Descriptor {
  name: string; // empty: the folder
  file: ReadableFile | null;
  at: number; // position of the next read
}

/**
 * @param onText  called with each text that the program writes
 * @param folder  the files that it may read
 */
export function wasi(
  memory: () => WebAssembly.Memory,
  onText: (text: string) => void,
  folder: () => Folder,
): WebAssembly.ModuleImports {
  const view = () => new DataView(memory().buffer);
  const bytes = (at: number, count: number) => new Uint8Array(memory().buffer, at, count);
  const textAt = (at: number, count: number) => new TextDecoder().decode(bytes(at, count).slice());

  const open = new Map<number, Descriptor>([[ROOT, { name: "", file: null, at: 0 }]]);
  let nextDescriptor = ROOT + 1;

  /** Name in the folder; empty: the folder itself; null: outside of it. */
  const nameOf = (path: string): string | null => {
    const parts = path.split("/").filter((part) => part !== "" && part !== ".");
    return parts.includes("..") ? null : parts.join("/");
  };
  const find = (path: string): Omit<Descriptor, "at"> | null => {
    const name = nameOf(path);
    if (name === null) return null;
    const file = folder().get(name) ?? null;
    return name === "" || file ? { name, file } : null;
  };
  const inode = (name: string) => BigInt([...folder().keys()].indexOf(name) + 2); // 1: the folder

  const putStatus = (at: number, { name, file }: Omit<Descriptor, "at">) => {
    bytes(at, 64).fill(0);
    view().setBigUint64(at, 1n, true);
    view().setBigUint64(at + 8, inode(name), true);
    view().setUint8(at + 16, file ? REGULAR_FILE : DIRECTORY);
    view().setBigUint64(at + 24, 1n, true);
    view().setBigUint64(at + 32, BigInt(file?.size ?? 0), true);
  };

  /** Reads into `count` pieces at `pieces`, from `from` on. Returns the number of bytes, or null if it fails. */
  const readInto = (file: ReadableFile, from: number, pieces: number, count: number): number | null => {
    let length = 0;
    try {
      for (let n = 0; n < count; n++) {
        const at = view().getUint32(pieces + 8 * n, true);
        const wanted = view().getUint32(pieces + 8 * n + 4, true);
        const received = file.read(from + length, wanted);
        bytes(at, received.length).set(received);
        length += received.length;
        if (received.length < wanted) break;
      }
    } catch {
      return null;
    }
    return length;
  };
  const readOnly = () => READ_ONLY;

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
      crypto.getRandomValues(bytes(at, length));
      return OK;
    },
    // nothing sleeps in a worker: JavaScript wakes it
    poll_oneoff: () => NOT_SUPPORTED,
    proc_exit: (code: number) => {
      throw new Error(String(code));
    },

    fd_write: (_file: number, pieces: number, count: number, written: number) => {
      let text = "";
      let length = 0;
      for (let n = 0; n < count; n++) {
        const from = view().getUint32(pieces + 8 * n, true);
        const size = view().getUint32(pieces + 8 * n + 4, true);
        text += textAt(from, size);
        length += size;
      }
      view().setUint32(written, length, true);
      onText(text);
      return OK;
    },

    fd_prestat_get: (descriptor: number, at: number) => {
      if (descriptor !== ROOT) return BAD_DESCRIPTOR;
      view().setUint32(at, 0, true);
      view().setUint32(at + 4, ROOT_NAME.length, true);
      return OK;
    },
    fd_prestat_dir_name: (descriptor: number, at: number, length: number) => {
      if (descriptor !== ROOT) return BAD_DESCRIPTOR;
      if (length < ROOT_NAME.length) return INVALID;
      bytes(at, ROOT_NAME.length).set(new TextEncoder().encode(ROOT_NAME));
      return OK;
    },
    path_open: (
      _folder: number,
      _lookup: number,
      path: number,
      length: number,
      how: number,
      _rights: bigint,
      _inherited: bigint,
      _flags: number,
      opened: number,
    ) => {
      if (how & (OPEN_CREATE | OPEN_TRUNCATE)) return READ_ONLY;
      const found = find(textAt(path, length));
      if (!found) return NO_ENTRY;
      if (how & OPEN_DIRECTORY && found.file) return NOT_A_DIRECTORY;
      open.set(nextDescriptor, { ...found, at: 0 });
      view().setUint32(opened, nextDescriptor++, true);
      return OK;
    },
    fd_close: (descriptor: number) => (descriptor !== ROOT && open.delete(descriptor) ? OK : BAD_DESCRIPTOR),
    fd_fdstat_get: (descriptor: number, at: number) => {
      const one = open.get(descriptor);
      if (!one) return BAD_DESCRIPTOR;
      bytes(at, 24).fill(0);
      view().setUint8(at, one.file ? REGULAR_FILE : DIRECTORY);
      view().setBigUint64(at + 8, ~0n, true); // every right
      view().setBigUint64(at + 16, ~0n, true);
      return OK;
    },
    fd_fdstat_set_flags: () => OK,
    fd_filestat_get: (descriptor: number, at: number) => {
      const one = open.get(descriptor);
      if (!one) return BAD_DESCRIPTOR;
      putStatus(at, one);
      return OK;
    },
    path_filestat_get: (_folder: number, _lookup: number, path: number, length: number, at: number) => {
      const found = find(textAt(path, length));
      if (!found) return NO_ENTRY;
      putStatus(at, found);
      return OK;
    },
    path_readlink: () => INVALID, // nothing is a link
    fd_pread: (descriptor: number, pieces: number, count: number, from: bigint, received: number) => {
      const file = open.get(descriptor)?.file;
      if (!file) return BAD_DESCRIPTOR;
      const length = readInto(file, Number(from), pieces, count);
      if (length === null) return READING_FAILED;
      view().setUint32(received, length, true);
      return OK;
    },
    fd_read: (descriptor: number, pieces: number, count: number, received: number) => {
      const one = open.get(descriptor);
      if (!one?.file) return BAD_DESCRIPTOR;
      const length = readInto(one.file, one.at, pieces, count);
      if (length === null) return READING_FAILED;
      one.at += length;
      view().setUint32(received, length, true);
      return OK;
    },
    fd_seek: (descriptor: number, by: bigint, whence: number, at: number) => {
      const one = open.get(descriptor);
      if (!one?.file) return BAD_DESCRIPTOR;
      const from = [0, one.at, one.file.size][whence];
      if (from === undefined || from + Number(by) < 0) return INVALID;
      one.at = from + Number(by);
      view().setBigUint64(at, BigInt(one.at), true);
      return OK;
    },
    // entries of 24 bytes with their names; the last one may be cut short, and is then asked for again
    fd_readdir: (descriptor: number, at: number, length: number, cookie: bigint, used: number) => {
      if (!open.has(descriptor) || open.get(descriptor)!.file) return BAD_DESCRIPTOR;
      let filled = 0;
      const names = [...folder().keys()];
      for (let n = Number(cookie); n < names.length && filled < length; n++) {
        const name = new TextEncoder().encode(names[n]!);
        const entry = new Uint8Array(24 + name.length);
        const fields = new DataView(entry.buffer);
        fields.setBigUint64(0, BigInt(n + 1), true);
        fields.setBigUint64(8, inode(names[n]!), true);
        fields.setUint32(16, name.length, true);
        fields.setUint8(20, REGULAR_FILE);
        entry.set(name, 24);
        const fits = entry.subarray(0, Math.min(entry.length, length - filled));
        bytes(at + filled, fits.length).set(fits);
        filled += fits.length;
      }
      view().setUint32(used, filled, true);
      return OK;
    },
    path_create_directory: readOnly,
    path_filestat_set_times: readOnly,
    path_link: readOnly,
    path_remove_directory: readOnly,
    path_rename: readOnly,
    path_symlink: readOnly,
    path_unlink_file: readOnly,
    fd_filestat_set_size: readOnly,
    fd_filestat_set_times: readOnly,
  };
}
