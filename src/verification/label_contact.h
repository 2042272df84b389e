#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"
#include "palpate/volume/volume.h"

namespace palpate {

inline constexpr std::uint64_t kLabelContactSeed = 20;

/// How much is tried.
struct LabelContactEffort {
  int offsets = 8;   ///< places of every plane between the voxels
  int sheets = 40;   ///< of each thickness
  int presses = 20;  ///< on every sheet
};

/// What the default method, the proxy, feels of label maps whose surfaces are known, without friction, from
/// labels to force as a scene is prepared: terraces along tilted planes, the seam of two labels, what lies
/// beneath, sheets as thin as a voxel; with limits. The same in every run. Errors: kInterrupted.
Result<std::vector<Figure>> label_contact_figures(const Progress& progress,
                                                  const LabelContactEffort& effort = {});

/// The suite "contact".
Result<SuiteReport> run_label_contact(const Progress& progress);

namespace label_contact {

/// Voxels that a digital plane's are joined by.
enum class Joined { kByFaces, kByEdges };

/// A digital plane, one voxel thick or more, across the middle of a cube. One as thick as the steps of all
/// three axes together is joined by faces, one as thick as the longest of them by edges and corners alone
/// (Reveilles 1991).
struct Sheet {
  Volume<LabelId> labels;  ///< 1: the sheet
  Eigen::Vector3d up;
  double thick_mm = 0;  ///< from the plane through the middle of the cube upward
};
/// @param up      unit
/// @param voxels  at least 1
Sheet sheet(const Eigen::Vector3d& spacing_mm, const Eigen::Vector3d& up, int voxels, Joined joined);

struct SheetPresses {
  int presses = 0, felt = 0, through = 0;
};
/// A point tool at 0.1 to 0.5 m/s, askew, at 1 kHz, at 250 Hz, or with ticks half as long or as long again,
/// 4 mm beyond the sheet or until it is through. The same for the same seed.
Result<SheetPresses> press_sheet(const Sheet& sheet, int presses, std::uint64_t seed);

}  // namespace label_contact
}  // namespace palpate
