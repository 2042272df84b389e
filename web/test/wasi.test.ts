import assert from "node:assert/strict";
import test from "node:test";
import { folderOf, nameInFolder } from "../src/worker/own_files.js";
import { wasi, type Folder, type ReadableFile } from "../src/worker/wasi.js";

type Call = (...values: (number | bigint)[]) => number;

/** A program's view of a folder of texts. */
class Program {
  readonly memory = new WebAssembly.Memory({ initial: 1 });
  readonly view = new DataView(this.memory.buffer);
  readonly calls: Record<string, Call>;

  constructor(texts: Record<string, string>) {
    const folder: Folder = new Map(Object.entries(texts).map(([name, text]) => [name, fileOf(text)]));
    this.calls = wasi(
      () => this.memory,
      () => {},
      () => folder,
    ) as Record<string, Call>;
  }
  put(at: number, text: string): number {
    return new TextEncoder().encodeInto(text, new Uint8Array(this.memory.buffer, at)).written;
  }
  text(at: number, length: number): string {
    return new TextDecoder().decode(new Uint8Array(this.memory.buffer, at, length).slice());
  }
  /** Descriptor, or the negative error number. */
  open(path: string, how = 0): number {
    const error = this.calls.path_open!(3, 0, 100, this.put(100, path), how, 0n, 0n, 0, 0);
    return error ? -error : this.view.getUint32(0, true);
  }
  read(descriptor: number, count: number, from?: number): string {
    this.view.setUint32(16, 1000, true);
    this.view.setUint32(20, count, true);
    const error =
      from === undefined
        ? this.calls.fd_read!(descriptor, 16, 1, 0)
        : this.calls.fd_pread!(descriptor, 16, 1, BigInt(from), 0);
    assert.equal(error, 0);
    return this.text(1000, this.view.getUint32(0, true));
  }
}

const fileOf = (text: string): ReadableFile => {
  const bytes = new TextEncoder().encode(text);
  return { size: bytes.length, read: (at, count) => bytes.subarray(at, at + count) };
};

test("a program opens and reads the files of its folder, and no others", () => {
  const program = new Program({ "knee.nrrd": "NRRD0004 voxels", "names.tsv": "1\tfemur" });
  const knee = program.open("knee.nrrd");
  assert.equal(program.read(knee, 4), "NRRD");
  assert.equal(program.read(knee, 100), "0004 voxels");
  assert.equal(program.read(knee, 6, 9), "voxels");
  assert.equal(program.read(program.open("./names.tsv"), 20), "1\tfemur");
  assert.equal(program.open("/other.nrrd"), -44);
  assert.equal(program.open("../etc/passwd"), -44);
  assert.equal(program.calls.fd_close!(knee), 0);
  assert.equal(program.calls.fd_read!(knee, 16, 1, 0), 8);
});

test("nothing can be written or made", () => {
  const program = new Program({ "knee.nrrd": "x" });
  assert.equal(program.open("new.nrrd", 1), -69);
  assert.equal(program.open("knee.nrrd", 8), -69);
  assert.equal(program.calls.path_unlink_file!(3, 100, 4), 69);
});

test("files have their sizes and identities, and the folder lists them", () => {
  const program = new Program({ "a.mhd": "header", "a.raw": "four" });
  const status = (path: string) => {
    assert.equal(program.calls.path_filestat_get!(3, 0, 100, program.put(100, path), 200), 0);
    const inode = program.view.getBigUint64(208, true);
    return { inode, kind: program.view.getUint8(216), size: Number(program.view.getBigUint64(232, true)) };
  };
  assert.equal(status("a.mhd").size, 6);
  assert.equal(status("a.raw").size, 4);
  assert.equal(status("a.raw").kind, 4);
  assert.equal(status(".").kind, 3);
  assert.notEqual(status("a.mhd").inode, status("a.raw").inode);

  // a buffer for one entry and a half: the cut one comes again
  const root = program.open(".", 2);
  const names: string[] = [];
  for (let cookie = 0n; ;) {
    assert.equal(program.calls.fd_readdir!(root, 300, 45, cookie, 0), 0);
    const used = program.view.getUint32(0, true);
    if (used === 0) break;
    names.push(program.text(324, program.view.getUint32(316, true)));
    cookie = program.view.getBigUint64(300, true);
  }
  assert.deepEqual(names, ["a.mhd", "a.raw"]);
});

test("a file that cannot be read any more is an error of reading", () => {
  const folder: Folder = new Map([
    [
      "gone",
      {
        size: 10,
        read: () => {
          throw new Error("NotReadableError");
        },
      },
    ],
  ]);
  const memory = new WebAssembly.Memory({ initial: 1 });
  const calls = wasi(
    () => memory,
    () => {},
    () => folder,
  ) as Record<string, Call>;
  new TextEncoder().encodeInto("gone", new Uint8Array(memory.buffer, 100));
  assert.equal(calls.path_open!(3, 0, 100, 4, 0, 0n, 0n, 0, 0), 0);
  new DataView(memory.buffer).setUint32(20, 4, true);
  assert.equal(calls.fd_read!(new DataView(memory.buffer).getUint32(0, true), 16, 1, 0), 29);
});

test("files of the user are read in blocks, wherever they are asked for", () => {
  const bytes = new Uint8Array(9_000_000).map((_, n) => (n * 7) % 251);
  let slices = 0;
  Object.assign(globalThis, {
    FileReaderSync: class {
      readAsArrayBuffer(slice: Uint8Array): ArrayBuffer {
        slices++;
        return slice.slice().buffer;
      }
    },
  });
  const file = { name: "a/b.nrrd", size: bytes.length, slice: (from: number, to: number) => bytes.subarray(from, to) };
  const own = folderOf([file as unknown as File]).get("a_b.nrrd")!;
  for (let at = 0; at < bytes.length; at += 65536)
    assert.deepEqual(own.read(at, 65536), bytes.subarray(at, at + 65536));
  assert.equal(slices, 3);
  assert.deepEqual(own.read(10, 5), bytes.subarray(10, 15));
  assert.deepEqual(own.read(8_999_998, 10), bytes.subarray(8_999_998));
  assert.equal(own.read(9_000_000, 10).length, 0);
});

test("a name of a file is no path", () => {
  assert.equal(nameInFolder("knee left.nii.gz"), "knee left.nii.gz");
  assert.equal(nameInFolder("../a\nb\\c"), ".._a_b_c");
  assert.equal(nameInFolder(".."), "_");
});
