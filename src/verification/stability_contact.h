#pragma once

#include <cstdint>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// How much is tried.
struct ContactEffort {
  int planes = 40;         ///< of random directions: friction, and a trembling tip on every fourth
  int turns = 8;           ///< axes about which the object turns under a tip that sticks
  double sticking_s = 10;  ///< each time
  int presses = 2000;      ///< on all structures together, at least one on each
  double voxel_mm = 0.6;   ///< of the generated knee that is pressed on
  int levers = 300;        ///< turned through plates
};
inline constexpr std::uint64_t kContactSeed = 5;

/// What the proxy does: how far its friction is from the coefficients that are set, how far it creeps while
/// it sticks, and how deep any place of its way lies below a structure that is pressed on or that a tool is
/// turned into; with limits. The same in every run. Errors: kInterrupted.
Result<std::vector<Figure>> contact_figures(const Progress& progress, const ContactEffort& effort = {});

}  // namespace palpate
