#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/model_change.h"

namespace palpate {

/// Law that a change selects. Requires ModelChange::is_of_law.
TissueLaw law_of(const ModelChange& change);

/// Constitutive law of soft tissue in each version of a recording's model.
class LawHistory {
 public:
  /// @param first        law of the model with which the recording begins
  /// @param cell_factor  its Model::tissue_cell_factor
  explicit LawHistory(TissueLaw first, double cell_factor = 1) : laws_{{0, first, cell_factor}} {}
  /// Applies a change, in the order of versions; changes of other kinds are ignored.
  void on_event(const ModelChange& change);
  TissueLaw at(std::uint32_t version) const { return from(version).law; }
  double cell_factor_at(std::uint32_t version) const { return from(version).cell_factor; }
  /// Whether any version has a law for which `is` returns true.
  template <class Is>
  bool any(const Is& is) const {
    return std::ranges::any_of(laws_, [&](const From& from) { return is(from.law); });
  }

 private:
  struct From {
    std::uint32_t version;  // first version with this law
    TissueLaw law;
    double cell_factor;
  };
  const From& from(std::uint32_t version) const;

  std::vector<From> laws_;  // ascending versions
};

}  // namespace palpate
