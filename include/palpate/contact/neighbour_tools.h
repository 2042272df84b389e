#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "palpate/geometry/geometry.h"

namespace palpate {

/// Contact of a device's tool with deformable tissue in one tick; input of the interaction with the tools of
/// other devices (neighbour_effect()).
struct TissueContact {
  double force_N = 0;            ///< Normal force on the tissue; 0: none
  double tangent_N_per_mm = 0;   ///< dF / d depth
  double displaced_mm = 0;       ///< Depth by which the other tools lowered the surface under this one
  double modulus_N_per_mm2 = 0;  ///< E* of the tissue; 0: no contact
  double base_per_mm = 0;        ///< -B E* of tissue on a rigid base; 0: a half-space, or softer
  double radius_mm = 0;          ///< Radius of the pressing sphere
  Point<Patient> at;             ///< Point of action on the undeformed surface
  Vector<Patient> outward;       ///< Direction of the force on the tool; unit
  int surface = -1;              ///< Index of the touched surface

  bool is_known() const { return modulus_N_per_mm2 > 0; }
  void hash_into(std::uint64_t& hash) const;
};

/// Effect of the other tools on one tool.
struct NeighbourEffect {
  double displaced_mm = 0;      ///< Depth by which they lower the undeformed surface under it
  Vector<Patient> force_per_N;  ///< Tangential force on it per unit of its own normal force
};
/// Superposition of the point forces of other tools (Boussinesq 1885): on a half-space each lowers the
/// surface by F / (pi E* r) at a distance r, less on a layer (pair_interaction_per_mm() in footprint.h). Only
/// tools on the same surface count, by the cosine between their normals. The mutual compliance is symmetric
/// in both tools, and limited so that their common stiffness matrix stays positive definite. The tangential
/// force makes the superposition conservative: each tool is pushed towards the dent of the other.
/// @param tissue_contacts  contacts of all devices in the last tick
/// @param device           index of the tool in `tissue_contacts`; its own entry supplies its last
///                         tangent stiffness
/// @param own              its contact; force, tangent and displacement are not read
NeighbourEffect neighbour_effect(std::span<const TissueContact> tissue_contacts, std::size_t device,
                                 const TissueContact& own);

}  // namespace palpate
