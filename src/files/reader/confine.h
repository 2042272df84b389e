#pragma once

#include <span>

/// Restrictions on a process that reads malicious bytes, effective even if they compromise it.
namespace palpate::reader {

/// True if a sanitizer is compiled in. Its runtime needs address space, files and system calls that are
/// denied to a confined process: then only the restrictions marked * apply.
bool sanitized();
/// True if this kernel can restrict a process to files (Landlock), and to system calls (seccomp).
bool can_restrict_files();
bool can_restrict_system_calls();

/// Irrevocably removes from a new process with a single thread
/// - * survival of `parent`, stdin, stdout and (without a sanitizer) stderr, all descriptors except those in
///   `retained_descriptors`, signal handlers, core dumps, and inspection by other processes;
/// - memory beyond 1 GiB more than it has, growing files, more than 64 descriptors, other processes, and new
///   privileges;
/// - opening by name any file not in `files` (Landlock), and opening for writing;
/// - all system calls except those for reading open files, non-executable memory, clocks and exit (seccomp,
///   on x86-64 and ARM64): others fail with EPERM.
/// Without Landlock or seccomp in the kernel, the other restrictions apply.
/// @param retained_descriptors  descriptors that stay open, including those of `files`
/// @param files                 descriptors of open files
void confine(int parent, std::span<const int> retained_descriptors, std::span<const int> files);

/// Denies all system calls except those listed at confine(). False if the kernel does not support it.
bool restrict_system_calls();

}  // namespace palpate::reader
