#pragma once

#include <cstdint>

#include "palpate/tissue/elastic_grid.h"

namespace palpate::internal::elastic {

/// Stiffness of a cell's four hourglass modes, as a part of `mu`: docs/concepts/tissue.md.
inline constexpr float kHourglass = 0.25f;

/// What the operator needs of a grid. Moduli are times h / 16.
struct Cells {
  ElasticLayout layout;
  const float* mu;
  const float* lambda;
  const std::uint8_t* held;  ///< by node; null: nothing is held
  float* scratch;            ///< scratch_floats(layout)
};
inline std::size_t scratch_floats(const ElasticLayout& layout) {
  return static_cast<std::size_t>(2) * 12 * (layout.row + ElasticLayout::kLanes);
}

/// force = K displacement, 0 where nodes are held. What is held may be displaced; what stands beyond the
/// last node of a row must be finite. The same bits on every SIMD target.
void apply_linear(const Cells& cells, const float* displacement, float* force);

/// The forces of a neo-Hookean body that is displaced so, as apply_linear's where it hardly is.
/// @param volumes  by cell: det F, 1 where nothing yields
void apply_neo_hookean(const Cells& cells, float cell_mm, const float* displacement, float* force,
                       float* volumes);
/// How these change from `base` on, for a small displacement.
void apply_neo_hookean_tangent(const Cells& cells, float cell_mm, const float* base,
                               const float* displacement, float* force);

}  // namespace palpate::internal::elastic
