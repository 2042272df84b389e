// Files of the user in the worker, which are read where they lie: nothing is copied, and nothing is sent.

import type { Folder, ReadableFile } from "./wasi.js";

/** Synchronous reader of files in workers, which TypeScript declares only in a library that excludes the DOM's. */
declare class FileReaderSync {
  readAsArrayBuffer(blob: Blob): ArrayBuffer;
}

/** Bytes that are read at a time: the program asks for much less. */
const BLOCK_BYTES = 1 << 22;

class OwnFile implements ReadableFile {
  readonly size: number;
  private block = new Uint8Array(0);
  private blockAt = 0;

  constructor(private readonly file: File) {
    this.size = file.size;
  }

  read(at: number, count: number): Uint8Array {
    const end = Math.min(this.size, at + count);
    if (at >= end) return new Uint8Array(0);
    if (at < this.blockAt || end > this.blockAt + this.block.length) {
      const until = Math.max(end, Math.min(this.size, at + BLOCK_BYTES));
      this.block = new Uint8Array(new FileReaderSync().readAsArrayBuffer(this.file.slice(at, until)));
      this.blockAt = at;
    }
    return this.block.subarray(at - this.blockAt, end - this.blockAt);
  }
}

/** Name under which the program finds a file; it may not contain what would be a path. */
export const nameInFolder = (name: string): string => name.replace(/[/\\\n\r\0]/g, "_").replace(/^\.+$/, "_");

/** The folder of the program; of two files of one name the later. */
export const folderOf = (files: readonly File[]): Folder =>
  new Map(files.map((file) => [nameInFolder(file.name), new OwnFile(file)]));
