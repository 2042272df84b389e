#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/tissue/stroke_history.h"

namespace palpate {

/// All sweeps that a model was cut by and all strokes that were undone or done again, each with the version
/// of the model that it led to. For any version it tells which sweeps are in force, done and not undone, in
/// their order. An undo takes sweeps off the end of that list.
class CutList {
 public:
  /// A stroke that was undone or done again.
  struct Change {
    std::uint32_t version = 0;
    StrokeAction action = StrokeAction::kUndo;
    std::size_t sweeps = 0;  ///< so many came before it, whatever became of them
  };

  /// Room for so many more sweeps and one more change, whose add() does not fail then.
  void reserve(std::size_t sweeps);
  /// @param version  never below one that was told before
  void add(std::uint32_t version, const SweepRecord& sweep);
  void add(std::uint32_t version, StrokeAction action);

  /// All, in their order.
  std::span<const SweepRecord> sweeps() const { return sweeps_; }
  std::span<const std::uint32_t> versions() const { return versions_; }  ///< of the sweeps
  std::span<const Change> changes() const { return changes_; }

  /// How many sweeps a version is cut by.
  std::size_t count(std::uint32_t version) const;
  /// Of these those from number `first` on, at most so many.
  std::vector<SweepRecord> by(std::uint32_t version, std::size_t first, std::size_t most) const;
  /// How long the list was after each undo up to that version.
  const std::vector<std::uint64_t>& undone_to(std::uint32_t version) const {
    return in_force(version).undone_to;
  }

 private:
  // sweeps, one after the other; without `end`
  struct Run {
    std::size_t begin = 0, end = 0;
  };
  /// What holds from one undo or redo to the next.
  struct InForce {
    std::vector<Run> runs;
    std::vector<std::uint64_t> undone_to;
    std::size_t goes_on = 0;  // sweeps from here on are in force, each from its version on
    std::size_t changes = 0;  // as many have led to it
    bool known = false;
  };
  const InForce& in_force(std::uint32_t version) const;
  std::size_t sweeps_until(std::uint32_t version) const;

  std::vector<SweepRecord> sweeps_;
  std::vector<std::uint32_t> versions_;
  std::vector<Change> changes_;
  mutable InForce last_;  // that was asked for
};

}  // namespace palpate
