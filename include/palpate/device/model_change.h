#pragma once

#include <cstdint>

#include "palpate/base/contact_properties.h"

namespace palpate {

/// Actions on a burr's stroke, which is the material removed between a start and a stop of its motor.
enum class StrokeAction : std::uint8_t { kUndo, kRedo };

/// Upper limit of Model::tissue_cell_factor.
inline constexpr double kMaxTissueCellFactor = 2;

/// Difference of a model version from the one before: a tissue's properties changed, the direct methods'
/// fields were rebuilt for the current stiffnesses, material was cut away, a stroke was undone or redone, or
/// soft tissue switched to another constitutive law.
struct ModelChange {
  static constexpr std::uint32_t kFieldsRebuilt = 0xffffffff;
  static constexpr std::uint32_t kCut = 0xfffffffe;   ///< Cut by the sweeps recorded before it
  static constexpr std::uint32_t kUndo = 0xfffffffd;  ///< Undo of the last stroke (StrokeHistory)
  static constexpr std::uint32_t kRedo = 0xfffffffc;
  /// Base value: plus the TissueLaw in effect from this version on
  static constexpr std::uint32_t kLaw = 0xfffffff0;
  static constexpr std::uint32_t kLaws = 5;
  std::uint32_t version = 0;  ///< One above the previous version
  std::uint32_t tissue = 0;   ///< Index of the tissue in the scene, from 0, or one of the codes above
  /// Properties of the tissue from this version on. For one of the law codes, the first is
  /// Model::tissue_cell_factor; 0: unchanged.
  ContactProperties contact{0, 0, 0, 0};

  bool is_of_tissue() const { return tissue < kLaw; }
  bool is_of_law() const { return tissue >= kLaw && tissue < kLaw + kLaws; }
  bool is_of_stroke() const { return tissue == kUndo || tissue == kRedo; }

  friend bool operator==(const ModelChange&, const ModelChange&) = default;
};

}  // namespace palpate
