#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"
#include "palpate/tissue/tissue_laws.h"
#include "palpate/tissue/yield_solver.h"

namespace palpate {

/// The solutions of tissue that yields that a recording tells of: from which row each was solved and in which
/// boxes, found while it is looked through, without solving anything. With that any of them can be solved
/// again without all those before it.
class YieldIndex {
 public:
  using Boxes = std::array<std::optional<YieldBox>, kMaxDevices>;
  struct Solution {
    std::uint32_t number = 0;  ///< YieldFrame::number, rising
    std::uint32_t boxes = 0;   ///< for boxes()
    std::uint64_t row = 0;     ///< of the tick that it was solved from
  };
  /// Four hours of them; later ones are not known.
  static constexpr std::size_t kMostSolutions = 1'000'000;

  /// @param model  as the recording began with, with the proxy's surfaces; outlives what is seen. A box that
  ///               is laid where something was cut is laid by the surface as it was before: a few cells
  ///               beside the one that there was, where a tool leans in a deep cut
  explicit YieldIndex(const Model& model) : model_(&model), laws_(model.tissue_law, model.tissue_coarsened) {}

  /// The next part of the recording. @param row  of its first tick
  void see(const RecordingPart& part, std::uint64_t row);

  bool empty() const { return solutions_.empty(); }
  /// The last of those with numbers up to that one, and up to `most` before it; nothing where that one is not
  /// known, or the tick that it was solved from is missing.
  std::span<const Solution> up_to(std::uint32_t number, std::size_t most) const;
  /// In which it was solved, of each device that has one.
  const Boxes& boxes(const Solution& solution) const { return boxes_[solution.boxes]; }

 private:
  // between two parts there are a few
  static constexpr std::size_t kMostTold = 10'000;
  struct Told {
    std::uint32_t number;
    std::uint64_t input_tick;
  };
  void take(const Told& told, const TickRecord& input, std::uint64_t row);
  const Model& model_of(std::uint32_t version);

  const Model* model_;
  LawsByVersion laws_;
  std::optional<Model> other_;  // the model by another law than it begins with
  std::vector<Solution> solutions_;
  std::vector<Boxes> boxes_;
  // whose tick is still to come, and the ticks before those that come next, in which it may be
  std::vector<Told> told_;
  std::vector<TickRecord> before_;
  std::uint64_t before_row_ = 0;
};

}  // namespace palpate
