#include "session/tip_source.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "palpate/device/device_parameters.h"
#include "palpate/servo/composite_driver.h"

namespace palpate {
namespace {

class ScriptSource final : public TipSource {
 public:
  ScriptSource(const RunSetup& setup, ScriptedHand hand, bool repeat)
      : model_(setup.model),
        workspace_(setup.workspace),
        device_name_(setup.script.device),
        hold_requests_(hand.requested()),
        planned_(std::move(hand)),
        driver_(resting_at(setup, planned_->start())),
        repeat_(repeat) {}

  DeviceDriver& driver() override { return driver_; }
  const char* name() const override { return "script"; }
  std::string devices() const override { return device_name_; }
  std::vector<HoldRequest> hold_requests() const override { return hold_requests_; }
  Result<void> begin(ServoLoop& loop, EventLog& log, ScriptEdits edits) override {
    hand_.emplace(*std::move(planned_), workspace_, driver_, loop, log, std::move(edits), repeat_);
    return hand_->begin();
  }
  bool done() const override { return hand_->done(); }
  double progress() const override { return hand_->progress(); }
  void end() override {
    if (hand_) hand_->end();
  }
  std::vector<std::string> problems() const override { return hand_->problems(); }
  std::vector<TouchFigure> touches() const override { return hand_->touches(); }

 private:
  // device at rest where the hand begins
  static SimulatedDevice resting_at(const RunSetup& setup, const Point<World>& start) {
    SimulatedDevice device(setup.device, setup.hand, setup.script.delay_s);
    device.reset(WorkspaceMapping(device.info(), setup.workspace).to_device(start));
    return device;
  }

  // the hand refers to this model for its lifetime, even if the session switches to another version
  const std::shared_ptr<const Model> model_;
  const WorkspaceSettings workspace_;
  const std::string device_name_;
  const std::vector<HoldRequest> hold_requests_;
  std::optional<ScriptedHand> planned_;
  SimulatedDriver driver_;
  const bool repeat_;
  std::optional<HandThread> hand_;
};

// no target forces are requested
std::vector<HoldRequest> all_touched(const Model& model) {
  std::vector<HoldRequest> holds;
  for (const LabelId structure : model.label_of_surface) holds.push_back({structure, {}});
  return holds;
}

/// Tip led by a person, locally or remotely: it needs no start and is never done.
class GuidedSource : public TipSource {
 public:
  explicit GuidedSource(const RunSetup& setup) : hold_requests_(all_touched(*setup.model)) {}
  std::vector<HoldRequest> hold_requests() const override { return hold_requests_; }
  Result<void> begin(ServoLoop& /*loop*/, EventLog& /*log*/, ScriptEdits /*edits*/) override { return {}; }
  bool done() const override { return false; }
  double progress() const override { return 0; }
  void end() override {}
  std::vector<std::string> problems() const override { return {}; }
  std::vector<TouchFigure> touches() const override { return {}; }

 private:
  const std::vector<HoldRequest> hold_requests_;
};

/// Tip moved by messages: of a viewer (kPointer), or of a node (kRos2Hand).
class PointerSource final : public GuidedSource {
 public:
  PointerSource(const RunSetup& setup, const char* name)
      : GuidedSource(setup), name_(name), driver_(resting_above(setup)) {}
  DeviceDriver& driver() override { return driver_; }
  const char* name() const override { return name_; }
  std::string devices() const override { return name_; }
  PointerDriver* pointer() override { return &driver_; }

 private:
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

  const char* const name_;
  PointerDriver driver_;
};

/// Physical device held by an operator.
class DeviceSource final : public GuidedSource {
 public:
  DeviceSource(const RunSetup& setup, std::string name, std::unique_ptr<DeviceDriver> driver)
      : GuidedSource(setup), name_(std::move(name)), driver_(std::move(driver)) {}
  DeviceDriver& driver() override { return *driver_; }
  const char* name() const override { return "device"; }
  std::string devices() const override { return name_; }

 private:
  const std::string name_;
  const std::unique_ptr<DeviceDriver> driver_;
};

/// Several sources combined. Script and progress are those of the first, the only one that can have a script.
class CombinedSources final : public TipSource {
 public:
  CombinedSources(std::vector<std::unique_ptr<TipSource>> sources, const CompositeDriverSettings& settings)
      : sources_(std::move(sources)), driver_(drivers_of(sources_), settings) {}

  DeviceDriver& driver() override { return driver_; }
  const char* name() const override { return leader().name(); }
  std::string devices() const override {
    std::string all;
    for (const auto& source : sources_) all += (all.empty() ? "" : ", ") + source->devices();
    return all;
  }
  std::vector<TickingThread> followers() const override { return driver_.followers(); }
  std::vector<HoldRequest> hold_requests() const override { return sources_[0]->hold_requests(); }
  PointerDriver* pointer() override {
    for (const auto& source : sources_)
      if (PointerDriver* pointer = source->pointer()) return pointer;
    return nullptr;
  }
  Result<void> begin(ServoLoop& loop, EventLog& log, ScriptEdits edits) override {
    return sources_[0]->begin(loop, log, std::move(edits));
  }
  bool done() const override { return sources_[0]->done(); }
  double progress() const override { return sources_[0]->progress(); }
  void end() override { sources_[0]->end(); }
  std::vector<std::string> problems() const override { return sources_[0]->problems(); }
  std::vector<TouchFigure> touches() const override { return sources_[0]->touches(); }

 private:
  static std::vector<DeviceDriver*> drivers_of(const std::vector<std::unique_ptr<TipSource>>& sources) {
    std::vector<DeviceDriver*> drivers;
    for (const auto& source : sources) drivers.push_back(&source->driver());
    return drivers;
  }
  const TipSource& leader() const {
    const auto guided =
        std::ranges::find_if(sources_, [](const auto& each) { return each->pointer() != nullptr; });
    return guided == sources_.end() ? *sources_[0] : **guided;
  }

  const std::vector<std::unique_ptr<TipSource>> sources_;
  CompositeDriver driver_;
};

Result<std::unique_ptr<TipSource>> script_source(const RunSetup& setup, bool repeat) {
  auto planned = ScriptedHand::create(*setup.model, setup.script);
  if (!planned) return planned.error();
  return std::unique_ptr<TipSource>(std::make_unique<ScriptSource>(setup, *std::move(planned), repeat));
}

Result<std::unique_ptr<TipSource>> source_of(const std::string& name, const RunSetup& setup,
                                             const ExploreOptions& options, const Progress& progress) {
  for (const char* by_messages : {kPointer, kRos2Hand})
    if (name == by_messages)
      return std::unique_ptr<TipSource>(std::make_unique<PointerSource>(setup, by_messages));
  if (name == kSimulatedHand) {
    progress.report("finding surfaces", 0);
    auto source = script_source(setup, options.repeat);
    progress.report("finding surfaces", 1);
    return source;
  }
  std::unique_ptr<DeviceDriver> driver = options.known.find(name)->make();
  progress.report("connecting " + name, 0);
  if (auto opened = driver->open(options.loop.may_move); !opened) return opened.error();
  progress.report("connecting " + name, 1);
  return std::unique_ptr<TipSource>(std::make_unique<DeviceSource>(setup, name, std::move(driver)));
}

// applies the devices' limits to the session
void apply_device_limits(std::span<const DeviceInfo> devices, const ExploreOptions& options, RunSetup& setup,
                         std::string& warning) {
  for (std::size_t d = 0; d < devices.size(); ++d) {
    const DeviceInfo& info = devices[d];
    // the stiffness limit of a hand with the simulated device is known more precisely
    const bool scripted = d == 0 && options.devices[0] == kSimulatedHand;
    if (!scripted) setup.parameters.device[d] = device_parameters(info, setup.workspace);
    if (info.simulated) continue;
    if (!options.run.max_force_N && info.continuous_force_N)
      setup.parameters.max_force_N = std::min(setup.parameters.max_force_N, *info.continuous_force_N);
    if (const std::string conservative_bounds = conservative_bound_message(info);
        !conservative_bounds.empty()) {
      setup.problems.push_back(conservative_bounds);
      warning += (warning.empty() ? "" : "\n") + conservative_bounds;
    }
  }
  setup.limit_N = std::min(setup.limit_N, setup.parameters.max_force_N);
}

}  // namespace

std::vector<std::string> device_names(const DeviceRegistry& known) {
  std::vector<std::string> names{kSimulatedHand, kPointer, kRos2Hand};
  for (const DeviceVendor& vendor : known.all()) names.push_back(vendor.name);
  return names;
}

Result<void> check_devices(const std::vector<std::string>& names, const DeviceRegistry& known) {
  const auto fault = [](std::string what, std::string remedy) {
    return Error{ErrorKind::kUsage, std::move(what), "--device", std::move(remedy)};
  };
  const std::vector<std::string> there = device_names(known);
  for (std::size_t n = 0; n < names.size(); ++n) {
    if (std::ranges::find(there, names[n]) == there.end()) {
      std::string all;
      for (const std::string& name : there) all += (all.empty() ? "" : ", ") + name;
      return fault("there is no device '" + names[n] + "'",
                   "there are: " + all + "; palpate devices shows what is connected");
    }
    if (std::find(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(n), names[n]) !=
        names.begin() + static_cast<std::ptrdiff_t>(n))
      return fault("'" + names[n] + "' is named twice", "name each device once");
    if (names.size() > 1 && names[n] == kRos2Hand)
      return fault("the hand of ROS 2 is the only device of its session", "leave out the others");
    if (n > 0 && names[n] == kSimulatedHand)
      return fault("the simulated hand must be the first device", "give 'simulated' first");
  }
  if (names.empty()) return fault("a session needs a device", "there are: simulated, pointer");
  if (names.size() > static_cast<std::size_t>(kMaxDevices))
    return fault(std::to_string(names.size()) + " devices",
                 "a session has " + std::to_string(kMaxDevices) + " at most");
  return {};
}

Result<std::unique_ptr<TipSource>> tip_source_for(RunSetup& setup, const ExploreOptions& options,
                                                  const Progress& progress, std::string& warning) {
  std::vector<std::unique_ptr<TipSource>> sources;
  for (const std::string& name : options.devices) {
    auto source = source_of(name, setup, options, progress);
    if (!source) return source.error();
    sources.push_back(*std::move(source));
  }
  std::size_t count = 0;
  for (const auto& source : sources) count += source->driver().devices().size();
  if (count > static_cast<std::size_t>(kMaxDevices))
    return Error{ErrorKind::kUsage, std::to_string(count) + " devices are connected", "--device",
                 "a session has " + std::to_string(kMaxDevices) + " at most: give fewer"};
  std::unique_ptr<TipSource> all;
  if (sources.size() == 1)
    all = std::move(sources[0]);
  else
    all = std::make_unique<CombinedSources>(
        std::move(sources),
        CompositeDriverSettings{setup.script.rate_hz, options.loop.realtime, options.loop.cpu});
  const DeviceDriver& driver = all->driver();
  const auto devices = driver.devices();
  // a session without a script ticks at the rate of its clock device
  const DeviceInfo& clock = devices[driver.clock_owner()];
  if (options.devices[0] != kSimulatedHand && clock.drive != DeviceInfo::Drive::kPulled && clock.rate_hz)
    setup.script.rate_hz = std::clamp(*clock.rate_hz, kMinRate_hz, kMaxRate_hz);
  apply_device_limits(devices, options, setup, warning);
  return all;
}

}  // namespace palpate
