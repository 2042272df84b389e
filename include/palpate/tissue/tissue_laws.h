#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"

namespace palpate {

/// Of a change for which ModelChange::is_of_law.
TissueLaw law_of(const ModelChange& change);

/// By which law soft tissue goes in each version of a recording's model.
class LawsByVersion {
 public:
  /// @param first      of the model that the recording begins with
  /// @param coarsened  Model::tissue_coarsened, likewise
  explicit LawsByVersion(TissueLaw first, double coarsened = 1) : laws_{{0, first, coarsened}} {}
  /// A change in the order of the versions; of another kind it does nothing.
  void hear(const ModelChange& change);
  TissueLaw at(std::uint32_t version) const { return from(version).law; }
  double coarsened_at(std::uint32_t version) const { return from(version).coarsened; }
  /// Whether any version goes by such a law.
  template <class Is>
  bool any(const Is& is) const {
    return std::ranges::any_of(laws_, [&](const From& from) { return is(from.law); });
  }

 private:
  struct From {
    std::uint32_t version;  // from that one on
    TissueLaw law;
    double coarsened;
  };
  const From& from(std::uint32_t version) const;

  std::vector<From> laws_;  // versions rise
};

}  // namespace palpate
