#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "contact/uninitialised_array.h"
#include "palpate/contact/proxy.h"

namespace palpate {

/// Structures along the penetration path, from the springs of all layers (docs/decisions/0018). Uses that the
/// sum of the layers' forces equals the sum, over layers, of the cumulated stiffness times the distance from
/// the layer's proxy to the next inner proxy.
class PenetrationPath {
 public:
  /// @param stretched_mm  spring vector of the layer, tip to proxy
  /// @param stiffness     stiffness of the layer, N/mm
  void begin_layer(const Vector<Patient>& stretched_mm, double stiffness) {
    layer_.make(layers_++, stretched_mm, stiffness, owners_);
    force_N_ += stretched_mm * stiffness;
  }
  /// Adds a structure's share of the layer that was begun last.
  /// @param fraction  0 ... 1
  void add_owner(int structure, double fraction);

  /// Writes ProxyResult::path.
  void report(ProxyResult& result) const;

 private:
  struct Layer {
    Vector<Patient> stretched_mm;
    double stiffness = 0;
    std::size_t first_owner = 0;
  };
  static constexpr std::size_t kMaxOwners = 24;

  static void report_largest(std::span<PathSegment> segments, double all_N, ProxyResult& result);

  UninitialisedArray<Layer, kMaxLayers> layer_;
  UninitialisedArray<OwnerFraction, kMaxOwners> owner_;
  std::size_t layers_ = 0, owners_ = 0;
  Vector<Patient> force_N_;
};

}  // namespace palpate
