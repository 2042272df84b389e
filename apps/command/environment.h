#pragma once

namespace palpate::app {

/// Removes environment variables by which libraries load code and settings, because palpate may have
/// capabilities that the creator of its environment does not have. Call it before anything else.
void sanitise_environment();

}  // namespace palpate::app
