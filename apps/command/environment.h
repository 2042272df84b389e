#pragma once

namespace palpate::app {

/// Removes environment variables by which libraries load code and settings, because palpate may have
/// capabilities that the creator of its environment does not have. Call it before anything else.
void sanitise_environment();

/// Lets this process reuse freed memory up to some hundred megabytes instead of returning it to the system at
/// once. The preparation of a scene allocates and frees arrays of megabytes throughout; without this, mapping
/// and clearing their pages again takes a third of its processor time. Only for programs: a library leaves
/// the allocator to its host. Call it before other threads exist.
void keep_freed_memory();

}  // namespace palpate::app
