#pragma once

#include <vector>

#include "phantoms/phantom_plan.h"

namespace palpate {

/// Individual variation of a knee: factors relative to the mean, and offsets, thicknesses and gaps in mm.
struct KneeShape {
  Eigen::Vector3d stretch{1, 1, 1};  ///< Scale of all parts about the centre of the joint.
  double medial_condyle = 1;         ///< Width and depth of the femoral condyles.
  double lateral_condyle = 1;
  double femoral_cartilage_mm = 2.0;
  double tibial_cartilage_mm = 2.5;
  double patellar_cartilage_mm = 2.9;
  double joint_gap_mm = 0.7;           ///< Free gap between cartilages.
  double patella = 1;                  ///< Factor of the radii.
  double patella_up_mm = 0;            ///< Displacement upwards.
  double meniscus = 1;                 ///< Factor of the width of its body.
  double ligament = 1;                 ///< Factor of the radii.
  Eigen::Vector3d fibula_mm{0, 0, 0};  ///< Offset.
};
/// Knee shape of a seed; seed 0 is the mean shape.
KneeShape knee_shape(std::uint64_t seed);

/// All parts in the anatomy's mm, with the joint line at z = 0; a left knee (lateral is +x) in extension,
/// without KneeShape::stretch. At a point in several parts the last one applies; labelled parts do not
/// overlap.
std::vector<PhantomPart> knee_phantom_parts(const KneeShape& shape = {});

/// Site of a lesion or defect: a point on the surface of `shape`, on the side from which the structure is
/// accessible or bears load.
struct KneeSite {
  Point<Patient> point;    ///< Point on the surface.
  Vector<Patient> normal;  ///< Outward unit normal.
};
/// Finds a site on a structure.
/// @param index  index of the site, from 0, for a structure with several accessible sites
KneeSite knee_site(const std::string& structure, const Shape& shape, std::size_t index = 0);
/// Number of sites of a structure, at most kMaxKneeSites.
std::size_t knee_site_count(const std::string& structure);
inline constexpr std::size_t kMaxKneeSites = 4;

}  // namespace palpate
