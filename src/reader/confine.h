#pragma once

#include <span>

/// What a process that reads hostile bytes cannot do, however far they have led it astray.
namespace palpate::reader {

/// Whether a sanitizer is compiled in. Its runtime needs addresses, files and system calls that a confined
/// process is refused: then only what is marked * below is taken away.
bool sanitized();
/// Whether this kernel holds a process to files (Landlock) and to system calls (seccomp).
bool can_hold_to_files();
bool can_hold_to_calls();

/// For a new process that has one thread: takes away for ever
/// - * life after `parent`, stdin, stdout and (where not sanitized) stderr, every descriptor but those of
///   `keep`, signal handlers, core files and being looked at by others;
/// - memory beyond what it has and 1 GiB, files that grow, more than 64 descriptors, other processes, new
///   privileges;
/// - opening by any name what is not one of `files` (Landlock), and opening to write;
/// - system calls but for reading what is open, memory without code in it, clocks and its own end (seccomp,
///   on x86-64 and ARM64): others fail with EPERM.
/// Where the kernel has no Landlock or no seccomp, the rest holds.
/// @param keep   descriptors that stay open, those of `files` included
/// @param files  descriptors of open files
void confine(int parent, std::span<const int> keep, std::span<const int> files);

/// Forbids all system calls but those of confine(). False where the kernel has none of that.
bool hold_to_calls();

}  // namespace palpate::reader
