#pragma once

#include <string>
#include <vector>

#include "palpate/primitives.h"

namespace palpate {

/// What a part of the phantom is made of, as an MR scanner sees it.
enum class PhantomMaterial : std::uint8_t {
  kFat,
  kMuscle,
  kFluid,
  kBone,  ///< bright marrow in a dark cortical rim
  kCartilage,
  kMeniscus,
  kLigament,
  kVessel,
};

/// One structure of the phantom.
struct PhantomPart {
  std::string name;
  LabelId label = 0;  ///< 0: seen in the scan, not segmented
  Rgb colour;
  PhantomMaterial material;
  Shape shape;
};

/// All parts in LPS mm, the joint line at z = 0, a left knee (lateral is +x) in extension. Where two parts
/// share a point the later one is there; labelled parts share none.
std::vector<PhantomPart> knee_phantom_parts();

}  // namespace palpate
