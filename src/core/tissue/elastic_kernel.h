#pragma once

#include <cstdint>

#include "palpate/tissue/elastic_layout.h"

namespace palpate::internal::elastic {

/// Stiffness of a cell's four hourglass modes, as a fraction of `mu`: docs/concepts/tissue.md.
inline constexpr float kHourglass = 0.25f;

/// Data of a grid for the stiffness operator. Moduli are multiplied by h / 16.
struct Cells {
  ElasticLayout layout;
  const float* mu;
  const float* lambda;
  const float* stiffening;  ///< ElasticConstants::stiffening by cell; read by the exponential law alone
  const std::uint8_t* constraints;  ///< Constraint bits by node; null: no constraints
  float* scratch;                   ///< scratch_floats(layout) values
};
inline std::size_t scratch_floats(const ElasticLayout& layout) {
  return static_cast<std::size_t>(2) * 12 * (layout.row + ElasticLayout::kLanes);
}

/// force = K displacement, 0 at constrained nodes. Constrained nodes may have a displacement; padding beyond
/// the last node of a row must be finite. Bit-identical on every SIMD target.
void apply_linear(const Cells& cells, const float* displacement, float* force);

/// Forces of a displaced neo-Hookean body; equal to apply_linear()'s for small displacements.
/// @param volumes  receives det F by cell, 1 in cells that are not soft
void apply_neo_hookean(const Cells& cells, float cell_mm, const float* displacement, float* force,
                       float* volumes);
/// Derivative of these forces at `base` in the direction of a small displacement.
void apply_neo_hookean_tangent(const Cells& cells, float cell_mm, const float* base,
                               const float* displacement, float* force);

/// Forces, and their derivative, of a body that stiffens with strain by Fung's exponential law
/// (ElasticConstants::stiffening); parameters as for the neo-Hookean functions. Cells without stiffening are
/// neo-Hookean to the bit.
void apply_exponential(const Cells& cells, float cell_mm, const float* displacement, float* force,
                       float* volumes);
void apply_exponential_tangent(const Cells& cells, float cell_mm, const float* base,
                               const float* displacement, float* force);

}  // namespace palpate::internal::elastic
