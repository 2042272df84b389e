#pragma once

#include <utility>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"

namespace palpate {

/// Of a change for which ModelChange::is_of_law.
TissueLaw law_of(const ModelChange& change);

/// By which law soft tissue goes in each version of a recording's model.
class LawsByVersion {
 public:
  /// @param first  of the model that the recording begins with
  explicit LawsByVersion(TissueLaw first) : laws_{{0, first}} {}
  /// A change in the order of the versions; of another kind it does nothing.
  void hear(const ModelChange& change);
  TissueLaw at(std::uint32_t version) const;

 private:
  std::vector<std::pair<std::uint32_t, TissueLaw>> laws_;  // from a version on; versions rise
};

}  // namespace palpate
