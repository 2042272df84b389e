#include "session/tip_source.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace palpate {
namespace {

class ScriptSource final : public TipSource {
 public:
  ScriptSource(const RunSetup& setup, ScriptedHand hand, bool repeat)
      : workspace_(setup.workspace),
        asked_(hand.asked()),
        planned_(std::move(hand)),
        driver_(resting_at(setup, planned_->start())),
        repeat_(repeat) {}

  DeviceDriver& driver() override { return driver_; }
  const char* name() const override { return "script"; }
  std::vector<HoldAsked> asked() const override { return asked_; }
  Result<void> begin(ServoLoop& loop, EventLog& told, ScriptStrokes strokes) override {
    hand_.emplace(*std::move(planned_), workspace_, driver_, loop, told, std::move(strokes), repeat_);
    return hand_->begin();
  }
  bool done() const override { return hand_->done(); }
  double progress() const override { return hand_->progress(); }
  void end() override {
    if (hand_) hand_->end();
  }
  std::vector<std::string> trouble() const override { return hand_->trouble(); }
  std::vector<TouchFigure> touches() const override { return hand_->touches(); }

 private:
  // the device rests where the hand begins
  static SimulatedDevice resting_at(const RunSetup& setup, const Point<World>& start) {
    SimulatedDevice device(setup.device, setup.hand, setup.script.delay_s);
    device.reset(WorkspaceMapping(device.info(), setup.workspace).to_device(start));
    return device;
  }

  const WorkspaceSettings workspace_;
  const std::vector<HoldAsked> asked_;
  std::optional<ScriptedHand> planned_;
  SimulatedDriver driver_;
  const bool repeat_;
  std::optional<HandThread> hand_;
};

class PointerSource final : public TipSource {
 public:
  explicit PointerSource(const RunSetup& setup)
      : asked_(touched(setup.model->label_of_surface)), driver_(resting_above(setup)) {}

  DeviceDriver& driver() override { return driver_; }
  const char* name() const override { return "pointer"; }
  std::vector<HoldAsked> asked() const override { return asked_; }
  PointerDriver* pointer() override { return &driver_; }
  Result<void> begin(ServoLoop& /*loop*/, EventLog& /*told*/, ScriptStrokes /*strokes*/) override {
    return {};
  }
  bool done() const override { return false; }
  double progress() const override { return 0; }
  void end() override {}
  std::vector<std::string> trouble() const override { return {}; }
  std::vector<TouchFigure> touches() const override { return {}; }

 private:
  // nobody asks for a force
  static std::vector<HoldAsked> touched(const std::vector<LabelId>& structures) {
    std::vector<HoldAsked> asked;
    for (const LabelId structure : structures) asked.push_back({structure, {}});
    return asked;
  }
  static Point<Device> resting_above(const RunSetup& setup) {
    const GridGeometry& grid = setup.model->labels->geometry();
    const Transform<World, Voxel> X_WorldVoxel = setup.model->X_WorldPatient * grid.X_PatientVoxel();
    double top_mm = 0;
    for (int corner = 0; corner < 8; ++corner) {
      Point<Voxel> p;
      for (int axis = 0; axis < 3; ++axis) p[axis] = (corner >> axis & 1) ? grid.dims[axis] - 1 : 0;
      top_mm = std::max(top_mm, (X_WorldVoxel * p).z());
    }
    constexpr double kClear_mm = 20;
    return WorkspaceMapping(PointerDriver::info(), setup.workspace)
        .to_device(Point<World>(0, 0, top_mm + kClear_mm));
  }

  const std::vector<HoldAsked> asked_;
  PointerDriver driver_;
};

}  // namespace

Result<std::unique_ptr<TipSource>> script_source(const RunSetup& setup, bool repeat) {
  auto planned = ScriptedHand::create(*setup.model, setup.script);
  if (!planned) return planned.error();
  return std::unique_ptr<TipSource>(std::make_unique<ScriptSource>(setup, *std::move(planned), repeat));
}

std::unique_ptr<TipSource> pointer_source(const RunSetup& setup) {
  return std::make_unique<PointerSource>(setup);
}

}  // namespace palpate
