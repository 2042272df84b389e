#include "palpate/report/moment.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "palpate/rendering/volume_picture.h"
#include "report/test_example_run.h"
#include "report/tool_marks.h"

namespace palpate::report {
namespace {

int count_of(const std::vector<VolumeMark>& marks, const Rgb& colour) {
  return static_cast<int>(std::count_if(marks.begin(), marks.end(),
                                        [&](const VolumeMark& mark) { return mark.colour == colour; }));
}

TEST(RecordedMoment, IsTheLastTickUntilThen) {
  const Model model = example::model();
  const Recording recording = example::recording(model);
  const auto& ticks = recording.ticks;
  ASSERT_GT(ticks.size(), 100u);
  for (const std::size_t n : {std::size_t{0}, ticks.size() / 3, ticks.size() / 2, ticks.size() - 1}) {
    const auto moment = recorded_moment(recording, model, ticks[n].time_s + 1e-7);
    ASSERT_TRUE(moment);
    EXPECT_EQ(moment->tick.tick, ticks[n].tick) << n;
    EXPECT_EQ(moment->time_s, ticks[n].time_s) << n;
    // paths end at the tip and extend at most two seconds back
    std::size_t points = 0;
    for (const auto& path : moment->paths) points += path.points.size();
    EXPECT_GE(points, std::min<std::size_t>(n + 1, 100)) << n;
    const auto& tip = ticks[n].device[0].tip_patient_mm;
    EXPECT_EQ(moment->paths.back().points.back(), Point<Patient>(tip[0], tip[1], tip[2])) << n;
  }
  // before the beginning and after the end
  EXPECT_EQ(recorded_moment(recording, model, ticks.front().time_s - 5)->tick.tick, ticks.front().tick);
  EXPECT_EQ(recorded_moment(recording, model, ticks.back().time_s + 5)->tick.tick, ticks.back().tick);
}

TEST(RecordedMoment, IsShownByToolProxyTipForceAndWay) {
  const Model model = example::model();
  const Recording recording = example::recording(model);
  const auto hardest = std::max_element(
      recording.ticks.begin(), recording.ticks.end(),
      [](const auto& a, const auto& b) { return force_N(a.device[0]) < force_N(b.device[0]); });
  const auto moment = recorded_moment(recording, model, hardest->time_s);
  ASSERT_TRUE(moment);
  VolumePictureRequest request;
  request.pixels = 256;
  const VolumeCamera camera = camera_of(model.labels->geometry(), request);
  const auto marks = moment_marks(*moment, model, camera);
  EXPECT_EQ(count_of(marks, kPositionColour), 1);
  EXPECT_EQ(count_of(marks, kForceColour), 2);  // shaft and head
  EXPECT_GT(count_of(marks, kToolColour), 0);
  EXPECT_GT(count_of(marks, kTouchingPathColour), 0);
  const auto drawn_line = std::find_if(marks.begin(), marks.end(),
                                       [](const VolumeMark& m) { return m.colour == kPositionColour; });
  EXPECT_EQ(drawn_line->from, proxy_position(*hardest, 0));
}

TEST(RecordedMoment, ShowsDeformedTissue) {
  const Model model = example::with_soft_tibia(example::model());
  const Recording recording = example::leaning_recording(model);
  const auto hardest =
      std::max_element(recording.ticks.begin(), recording.ticks.end(), [](const auto& a, const auto& b) {
        const auto in_tibia = [](const TickRecord& tick) {
          return tick.device[0].label == example::kTibia ? force_N(tick.device[0]) : 0;
        };
        return in_tibia(a) < in_tibia(b);
      });
  const auto moment = recorded_moment(recording, model, hardest->time_s);
  ASSERT_TRUE(moment);
  ASSERT_NE(moment->current_model, nullptr);
  EXPECT_GT(moment->dent_mm[0].norm(), 0.2);
  // the tissue is displaced away from the hand
  EXPECT_LT(moment->dent_mm[0].dot(patient_force_N(model, *hardest, 0)), 0);
  const GridGeometry& grid = model.labels->geometry();
  const Point<Patient> position = proxy_position(*hardest, 0);
  int others = 0;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        if (moment->current_model->labels->at(i, j, k) == model.labels->at(i, j, k)) continue;
        ++others;
        ASSERT_LT((grid.X_PatientVoxel() * Point<Voxel>(i, j, k) - position).norm(), 100);
      }
  EXPECT_GT(others, 0);
  // before the first contact the tissue is at rest
  EXPECT_EQ(recorded_moment(recording, model, recording.ticks.front().time_s)->current_model, nullptr);
}

TEST(RecordedMoment, IsEmptyForAnotherModel) {
  Model model = example::model();
  const Recording recording = example::recording(model);
  model.content_hash ^= 1;
  const auto moment = recorded_moment(recording, model, 0);
  ASSERT_FALSE(moment);
  EXPECT_EQ(moment.error().kind, ErrorKind::kBadInput);
}

TEST(RecordedMoment, NoMomentWithoutTicks) {
  const Model model = example::model();
  Recording recording = example::recording(model);
  recording.ticks.clear();
  EXPECT_FALSE(recorded_moment(recording, model, 0));
}

}  // namespace
}  // namespace palpate::report
