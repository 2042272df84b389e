#pragma once

#include <array>
#include <string_view>

#include "palpate/scene/scene.h"

namespace palpate {

/// Elastic constants of a preset. Presets without an entry (bone) are rigid.
struct ElasticPreset {
  std::string_view preset;
  ElasticConstants constants;
  std::array<double, 2> range_kPa;
  std::string_view source;
  /// Range of ElasticConstants::stiffening and its source; empty: not known to stiffen.
  std::array<double, 2> stiffening_range{};
  std::string_view stiffening_source = {};
};

/// Elastic constants of a preset; null: it is rigid.
const ElasticPreset* elastic_preset(std::string_view preset);
/// Measured relaxation of a preset; null: none was measured.
const Relaxation* measured_relaxation(std::string_view preset);

}  // namespace palpate
