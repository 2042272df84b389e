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

/// Number of trials.
struct LabelContactEffort {
  int offsets = 8;   ///< Positions of every plane relative to the voxels
  int sheets = 40;   ///< Sheets per thickness
  int presses = 20;  ///< Presses per sheet
};

/// Contact by the default method, the proxy without friction, with label maps whose surfaces are known, from
/// labels to force as a scene is prepared: terraces along oblique planes, the seam of two labels, layers
/// beneath, sheets as thin as a voxel; with limits. Deterministic. Errors: kInterrupted.
Result<std::vector<Figure>> label_contact_figures(const Progress& progress,
                                                  const LabelContactEffort& effort = {});

/// Runs the suite "contact".
Result<SuiteReport> run_label_contact(const Progress& progress);

namespace label_contact {

/// Connectivity of the voxels of a digital plane.
enum class Joined { kByFaces, kByEdges };

/// A digital plane, at least one voxel thick, through the centre of a cube. With the thickness of the sum of
/// the steps of all three axes it is face-connected; with that of the largest step it is only connected by
/// edges and corners (Reveilles 1991).
struct Sheet {
  Volume<LabelId> labels;  ///< Label 1 is the sheet
  Eigen::Vector3d up;
  double thick_mm = 0;  ///< Thickness, upwards from the plane through the centre of the cube
};
/// @param up      unit normal
/// @param voxels  thickness in voxels, at least 1
Sheet sheet(const Eigen::Vector3d& spacing_mm, const Eigen::Vector3d& up, int voxels, Joined joined);

struct SheetPresses {
  int presses = 0, detected = 0, through = 0;
};
/// Presses a point tool through a sheet in oblique directions at 0.1 to 0.5 m/s, at 1 kHz, at 250 Hz, or with
/// tick lengths that vary by half, up to 4 mm beyond the sheet or until it is through. Deterministic for a
/// seed.
Result<SheetPresses> press_sheet(const Sheet& sheet, int presses, std::uint64_t seed);

}  // namespace label_contact
}  // namespace palpate
