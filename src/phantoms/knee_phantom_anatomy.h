#pragma once

#include <vector>

#include "phantoms/phantom_plan.h"

namespace palpate {

/// How one knee differs from the next: factors of the mean and offsets, thicknesses and gaps in mm.
struct KneeShape {
  Eigen::Vector3d stretch{1, 1, 1};  ///< of everything, about the middle of the joint
  double medial_condyle = 1;         ///< width and depth of the femoral condyles
  double lateral_condyle = 1;
  double femoral_cartilage_mm = 2.0;
  double tibial_cartilage_mm = 2.5;
  double patellar_cartilage_mm = 2.9;
  double joint_gap_mm = 0.7;           ///< free, between cartilages
  double patella = 1;                  ///< radii
  double patella_up_mm = 0;            ///< how much higher it stands
  double meniscus = 1;                 ///< width of its body
  double ligament = 1;                 ///< radii
  Eigen::Vector3d fibula_mm{0, 0, 0};  ///< offset
};
/// The knee of a seed; seed 0 is the mean one.
KneeShape knee_shape(std::uint64_t seed);

/// All parts in the anatomy's mm, the joint line at z = 0, a left knee (lateral is +x) in extension. Where
/// two parts share a point the later one is there; labelled parts share none. Not stretched.
std::vector<PhantomPart> knee_phantom_parts(const KneeShape& shape = {});

/// Where a lesion or a defect of a structure lies: on the surface of `shape`, from where the structure is
/// reached or bears load.
struct KneeSite {
  Point<Patient> point;
  Vector<Patient> normal;  ///< outward
};
/// @param place  which one, from 0: a place where a probe comes to it, of those of a structure that has
/// several
KneeSite knee_site(const std::string& structure, const Shape& shape, std::size_t place = 0);
/// How many places a structure has, at most kKneePlaces.
std::size_t knee_places(const std::string& structure);
inline constexpr std::size_t kKneePlaces = 4;

}  // namespace palpate
