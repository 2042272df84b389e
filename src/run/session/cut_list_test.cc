#include "session/cut_list.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <utility>

namespace palpate {
namespace {

SweepRecord sweep_of(std::uint32_t stroke, double number) {
  SweepRecord sweep;
  sweep.stroke = stroke;
  sweep.radius_mm = number;
  return sweep;
}

TEST(CutList, EveryVersionHasTheSweepsOfItsStrokes) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 engine(seed);
  const auto random = [&] { return static_cast<std::uint32_t>(engine()); };
  CutList list;
  // oracle: strokes as lists of sweeps, and the sweeps in force after each version
  using Strokes = std::vector<std::vector<SweepRecord>>;
  Strokes done, undone;
  std::vector<std::vector<SweepRecord>> of_version{{}};
  std::vector<std::vector<std::uint64_t>> undone_to{{}};
  std::uint32_t version = 0, stroke = 0;
  double number = 0;
  bool continues = false;
  for (int n = 0; n < 300; ++n) {
    ++version;
    std::vector<std::uint64_t> left = undone_to.back();
    if (const unsigned action = random() % 5; action < 3) {
      if (action == 0 || !continues) {
        ++stroke;
        done.emplace_back();
        undone.clear();
      }
      continues = true;
      for (unsigned sweeps = 1 + random() % 3; sweeps > 0; --sweeps) {
        done.back().push_back(sweep_of(stroke, ++number));
        list.add(version, done.back().back());
      }
    } else {
      const bool undo = action == 3;
      list.add(version, undo ? StrokeAction::kUndo : StrokeAction::kRedo);
      Strokes &from = undo ? done : undone, &to = undo ? undone : done;
      if (!from.empty()) {
        to.push_back(std::move(from.back()));
        from.pop_back();
        continues = false;
      }
    }
    std::vector<SweepRecord> in_force;
    for (const auto& sweeps : done) in_force.insert(in_force.end(), sweeps.begin(), sweeps.end());
    if (!list.changes().empty() && list.changes().back().version == version &&
        list.changes().back().action == StrokeAction::kUndo)
      left.push_back(in_force.size());
    of_version.push_back(in_force);
    undone_to.push_back(left);
  }
  // random access, as when seeking in a recording
  for (int n = 0; n < 2000; ++n) {
    const std::uint32_t at = random() % (version + 1);
    const std::vector<SweepRecord>& oracle = of_version[at];
    ASSERT_EQ(list.count_at(at), oracle.size()) << at;
    ASSERT_EQ(list.undone_to(at), undone_to[at]) << at;
    const std::size_t first = random() % (oracle.size() + 2), most = random() % 20;
    std::vector<SweepRecord> some;
    for (std::size_t i = first; i < oracle.size() && some.size() < most; ++i) some.push_back(oracle[i]);
    ASSERT_EQ(list.sweeps_at(at, first, most), some) << at << " " << first << " " << most;
  }
}

}  // namespace
}  // namespace palpate
