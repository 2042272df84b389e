#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/haptics/haptics.h"

/// What the values of a tissue may be, in a scene and while they are felt.
namespace palpate {

/// Both ends belong to it.
struct ValueRange {
  double min, max;
};
inline constexpr ValueRange kStiffnessRange_N_per_mm{0.001, 20};
inline constexpr ValueRange kFrictionRange{0, 2};
inline constexpr ValueRange kViscosityRange_N_s_per_mm{0, 0.1};

/// What is wrong, and how to mend it.
struct TissueFault {
  std::string what, remedy;
};
/// What sticks holds at least as much as what slides.
std::optional<TissueFault> friction_fault(double static_friction, double friction);

/// Of a tissue, as far as what rests on it or what it rests on has to know.
struct SupportValues {
  std::string_view name;
  double stiffness_N_per_mm = 0;
  bool felt = true;
};
/// The field is never to fall on the way from a tissue into its support: where it falls, the direct methods'
/// force points inward.
std::optional<TissueFault> support_fault(const SupportValues& tissue, const SupportValues& support);

/// Whether a tissue may have these values, in the words with which a scene's text is refused: ranges,
/// friction and supports.
/// @param index  of the one whose values are new
/// Error kBadInput; its place is the scene's key ("stiffness").
Result<void> check_tissue_values(const std::vector<Tissue>& tissues, std::size_t index);

}  // namespace palpate
