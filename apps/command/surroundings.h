#pragma once

namespace palpate::app {

/// Forgets what the environment says to libraries about code and settings that they should load: palpate may
/// have capabilities that whoever set its environment has not. To be called before anything else.
void distrust_environment();

}  // namespace palpate::app
