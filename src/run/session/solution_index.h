#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/telemetry.h"
#include "palpate/recording/recording_source.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "palpate/tissue/tissue_laws.h"

namespace palpate {

/// Index of the tissue solutions of a recording: input row and solver boxes of each, collected in a single
/// pass without solving. With it any solution can be solved again without all those before it.
class SolutionIndex {
 public:
  using Boxes = std::array<std::optional<SolverBox>, kMaxDevices>;
  struct Solution {
    std::uint32_t number = 0;  ///< ComplianceFrame::number, ascending
    std::uint32_t boxes = 0;   ///< Index for boxes()
    std::uint64_t row = 0;     ///< Row of its input tick
  };
  /// Four hours of solutions; later ones are not indexed.
  static constexpr std::size_t kMaxSolutions = 1'000'000;

  /// @param model  at the beginning of the recording, with the proxy's surfaces; outlives the index. A box in
  /// a cut region is placed by the surface before the cut: it may differ by a few cells from the original box
  /// where a tool presses in a deep cut
  explicit SolutionIndex(const Model& model)
      : model_(&model), laws_(model.tissue_law, model.tissue_cell_factor) {}

  /// Adds the next part of the recording.
  /// @param row  row of its first tick
  void observe(const RecordingPart& part, std::uint64_t row);

  bool empty() const { return solutions_.empty(); }
  /// Solution `number` and up to `max_count` solutions before it; empty if that solution is not indexed or
  /// its input tick is missing.
  std::span<const Solution> up_to(std::uint32_t number, std::size_t max_count) const;
  /// Solver boxes of a solution, per device.
  const Boxes& boxes(const Solution& solution) const { return boxes_[solution.boxes]; }

 private:
  // bound on pending solutions; a few are normal
  static constexpr std::size_t kMaxPending = 10'000;
  struct Frame {
    std::uint32_t number;
    std::uint64_t input_tick;
    bool is_solved;
  };
  void take(const Frame& frame, const TickRecord& input, std::uint64_t row);
  const Model& model_of(std::uint32_t version);

  const Model* model_;
  LawHistory laws_;
  std::optional<Model> other_;  // the model under another law than its initial one
  std::vector<Solution> solutions_;
  std::vector<Boxes> boxes_;
  // solutions whose input tick is still to come, and the preceding ticks, among which it may be
  std::vector<Frame> frames_;
  std::vector<TickRecord> before_;
  std::uint64_t before_row_ = 0;
};

}  // namespace palpate
