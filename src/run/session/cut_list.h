#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/device/sweep_record.h"
#include "palpate/tissue/stroke_history.h"

namespace palpate {

/// Sweeps and stroke changes of a session, each with the model version that it produced. For any version it
/// returns the sweeps in force (cut and not undone), in order. An undo removes sweeps from the end of that
/// list.
class CutList {
 public:
  /// Undo or redo of a stroke.
  struct Change {
    std::uint32_t version = 0;
    StrokeAction action = StrokeAction::kUndo;
    std::size_t sweeps = 0;  ///< Number of sweeps before it, whether in force or not
  };

  /// Reserves memory for that many further sweeps and one change, so that add() cannot fail.
  void reserve(std::size_t sweeps);
  /// @param version  not lower than any version passed before
  void add(std::uint32_t version, const SweepRecord& sweep);
  void add(std::uint32_t version, StrokeAction action);

  /// All sweeps and changes in chronological order.
  std::span<const SweepRecord> sweeps() const { return sweeps_; }
  std::span<const std::uint32_t> versions() const { return versions_; }  ///< Versions of the sweeps
  std::span<const Change> changes() const { return changes_; }

  /// Number of sweeps in force at a version.
  std::size_t count_at(std::uint32_t version) const;
  /// Sweeps in force at a version, from index `first` on, at most `max_count`.
  std::vector<SweepRecord> sweeps_at(std::uint32_t version, std::size_t first, std::size_t max_count) const;
  /// Length of the list after each undo up to that version.
  const std::vector<std::uint64_t>& undone_to(std::uint32_t version) const {
    return in_force(version).undone_to;
  }

 private:
  // half-open range of sweep indices
  struct Run {
    std::size_t begin = 0, end = 0;
  };
  /// State between two consecutive undos or redos.
  struct InForce {
    std::vector<Run> runs;
    std::vector<std::uint64_t> undone_to;
    std::size_t continues = 0;  // sweeps from this index on are in force, each from its own version on
    std::size_t changes = 0;    // number of changes that led to this state
    bool known = false;
  };
  const InForce& in_force(std::uint32_t version) const;
  std::size_t sweeps_until(std::uint32_t version) const;

  std::vector<SweepRecord> sweeps_;
  std::vector<std::uint32_t> versions_;
  std::vector<Change> changes_;
  mutable InForce last_;  // cache of the last query
};

}  // namespace palpate
