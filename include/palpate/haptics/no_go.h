#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/haptics/distances.h"

/// Regions that a tool is to keep out of, felt or not: forbidden-region virtual fixtures (Rosenberg 1993;
/// Abbott, Marayong & Okamura 2007) on the region's own distance.
namespace palpate {

/// All of a structure, felt or not.
struct NoGoStructure {
  LabelId label = 0;
  int tracked = -1;  ///< its place among Distances::structures(); -1: not prepared, no force
};
/// All that lies behind a plane.
struct NoGoPlane {
  Point<Patient> point;
  Vector<Patient> outward;  ///< unit, towards where the tool may be
};
/// A ball.
struct NoGoSphere {
  Point<Patient> centre;
  double radius_mm = 1;
};

/// What a region's numbers may be.
inline constexpr double kMostKeepAway_mm = 20;
inline constexpr struct { double min, max; } kNoGoStiffness_N_per_mm{0.01, 20}, kNoGoRadius_mm{0.1, 500};

struct NoGoRegion {
  std::string name;
  std::variant<NoGoStructure, NoGoPlane, NoGoSphere> place;
  double keep_away_mm = 0;        ///< so far before the region the force begins; 0 ... kMostKeepAway_mm
  double stiffness_N_per_mm = 1;  ///< kNoGoStiffness_N_per_mm
};
inline constexpr std::size_t kMostNoGo = 64;  ///< regions of a model

/// Errors: kBadInput for more than kMostNoGo regions, a number out of its range, a plane whose `outward` is
/// not of length 1.
Result<void> check_no_go(std::span<const NoGoRegion> regions);

/// What all regions together do to a tool.
struct NoGoForce {
  Vector<Patient> force_N;        ///< on the tip
  Vector<Patient> torque_Nmm;     ///< about the tip
  double stored_mJ = 0;           ///< energy that it holds, as a spring does
  double stiffness_N_per_mm = 0;  ///< of the stiffest region that pushes; 0: none does
  int region = -1;                ///< the one that the tool is deepest in; -1: no region pushes
  double depth_mm = 0;            ///< of that one: how far the tool's outline is within keep_away_mm
};

/// One-sided springs: a tool that comes nearer to a region than it is to keep away is pushed out along the
/// way on which the distance grows, at the place of the tool that is nearest, by stiffness times depth.
///
/// Where several regions push, a proxy lies between tip and springs: the force is that of a spring of
/// `most_stiffness_N_per_mm` from the tip to the place u that makes the energy of that spring and of all
/// regions' together least (Moreau's envelope of the regions' energy). So no direction is stiffer than the
/// most however many regions overlap, and one region alone has its own stiffness: the region's spring is that
/// much stiffer as the one before it takes away. Regions are taken as flat around the tool: of planes the
/// force has a potential, of what is curved nearly so.
///
/// Regions are met at most kMostNoGoMet at a time, the deepest. Remembers nothing; bounded work; allocates,
/// locks and throws nothing.
/// @param spheres                 the tool's, as the hand holds it
/// @param most_stiffness_N_per_mm  in the patient; no region is stiffer than nine tenths of it. 0: no force
NoGoForce push_out_of(std::span<const NoGoRegion> regions, const Distances& distances,
                      std::span<const ToolSphere> spheres, const Point<Patient>& tip,
                      double most_stiffness_N_per_mm = std::numeric_limits<double>::infinity());
inline constexpr std::size_t kMostNoGoMet = 8;

}  // namespace palpate
