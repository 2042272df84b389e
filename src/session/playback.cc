#include "palpate/playback.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <list>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "palpate/force_method.h"
#include "palpate/haptics.h"
#include "session/recorded_model.h"
#include "session/recording_line.h"
#include "session/viewed_scene.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;
using Block = std::vector<TickRecord>;

/// Ticks that are read at once, and how many such blocks are kept: some 40 MB.
constexpr std::uint64_t kBlockTicks = 4096;
constexpr std::size_t kMostBlocks = 4;

Error is_a_recording() {
  return {ErrorKind::kUsage, "this is a recording: what was felt cannot be changed", "",
          "palpate explore feels the scene anew"};
}

/// Where one stands in a recording. One thread at a time.
class Place {
 public:
  Place(double begin_s, double end_s) : begin_s_(begin_s), end_s_(end_s), from_s_(begin_s) {}

  double now_s() {
    if (!playing_) return from_s_;
    const double passed_s = std::chrono::duration<double>(Clock::now() - since_).count();
    const double now_s = from_s_ + speed_ * passed_s;
    if (now_s > begin_s_ && now_s < end_s_) return now_s;
    // it rests at the end that it came to
    if (speed_ > 0 ? now_s >= end_s_ : now_s <= begin_s_) stand(speed_ > 0 ? end_s_ : begin_s_, false);
    return std::clamp(now_s, begin_s_, end_s_);
  }
  bool playing() {
    (void)now_s();
    return playing_;
  }
  double speed() const { return speed_; }

  void follow(const PlayRequest& request) {
    double at_s = std::clamp(request.at_s.value_or(now_s()), begin_s_, end_s_);
    speed_ = request.speed.value_or(speed_);
    const bool plays = request.playing.value_or(playing_);
    const double end_s = speed_ > 0 ? end_s_ : begin_s_;
    if (request.playing == true && !request.at_s && at_s == end_s) at_s = speed_ > 0 ? begin_s_ : end_s_;
    stand(at_s, plays);
  }
  void stop() { stand(now_s(), false); }

 private:
  void stand(double at_s, bool plays) {
    from_s_ = at_s;
    since_ = Clock::now();
    playing_ = plays;
  }

  const double begin_s_, end_s_;
  double from_s_, speed_ = 1;
  Clock::time_point since_ = Clock::now();
  bool playing_ = false;
};

/// The ticks around a place, read by a thread of its own.
class Blocks {
 public:
  Blocks(RecordingSource source, std::vector<double> begins_s)
      : source_(std::move(source)), begins_s_(std::move(begins_s)), reader_([this] { read(); }) {}
  ~Blocks() {
    ending_ = true;
    {
      const std::lock_guard lock(mutex_);
      wanted_changed_.notify_all();
    }
    reader_.join();
  }
  Blocks(const Blocks&) = delete;
  Blocks& operator=(const Blocks&) = delete;

  /// The last tick that is not after `at_s`, where it has been read; else it will be.
  /// @param way  where the next block is that will be wanted: 1 or -1, or 0 where it rests
  std::optional<TickRecord> tick_at(double at_s, int way) {
    const auto after = std::ranges::upper_bound(begins_s_, at_s);
    const std::size_t block =
        after == begins_s_.begin() ? 0 : static_cast<std::size_t>(after - begins_s_.begin()) - 1;
    const std::lock_guard lock(mutex_);
    if (block != wanted_ || way != way_) {
      wanted_ = block;
      way_ = way;
      wanted_changed_.notify_all();
    }
    const Block* ticks = find(block);
    if (ticks == nullptr) return std::nullopt;
    const auto next = std::ranges::upper_bound(*ticks, at_s, {}, &TickRecord::time_s);
    return *(next == ticks->begin() ? next : next - 1);
  }
  std::optional<Error> failure() const {
    const std::lock_guard lock(mutex_);
    return failure_;
  }
  /// What could not be read is read anew: a busy machine has no process for a reader now and then.
  void try_again() {
    const std::lock_guard lock(mutex_);
    failure_.reset();
    wanted_changed_.notify_all();
  }

 private:
  struct Kept {
    std::size_t number;
    Block ticks;
  };

  // what was wanted last stands first
  const Block* find(std::size_t block) {
    const auto found = std::ranges::find(kept_, block, &Kept::number);
    if (found == kept_.end()) return nullptr;
    kept_.splice(kept_.begin(), kept_, found);
    return &kept_.front().ticks;
  }
  bool is_kept(std::size_t block) const {
    return std::ranges::find(kept_, block, &Kept::number) != kept_.end();
  }
  // with the mutex
  std::optional<std::size_t> missing() const {
    if (failure_) return std::nullopt;
    if (!is_kept(wanted_)) return wanted_;
    if (way_ > 0 && wanted_ + 1 < begins_s_.size() && !is_kept(wanted_ + 1)) return wanted_ + 1;
    if (way_ < 0 && wanted_ > 0 && !is_kept(wanted_ - 1)) return wanted_ - 1;
    return std::nullopt;
  }

  void read() {
    const Progress progress({}, &ending_);
    std::unique_lock lock(mutex_);
    while (!ending_) {
      const auto block = missing();
      if (!block) {
        wanted_changed_.wait(lock);
        continue;
      }
      lock.unlock();
      auto ticks = read_block(*block, progress);
      lock.lock();
      if (!ticks) {
        failure_ = ticks.error();
        continue;
      }
      kept_.push_front({*block, *std::move(ticks)});
      if (kept_.size() > kMostBlocks) kept_.pop_back();
    }
  }
  Result<Block> read_block(std::size_t block, const Progress& progress) const {
    auto ticks = source_.read_at(block * kBlockTicks, kBlockTicks, progress);
    if (!ticks) return ticks.error();
    // times are looked for in it
    if (ticks->empty() || !std::ranges::is_sorted(*ticks, {}, &TickRecord::time_s) ||
        ticks->front().time_s != begins_s_[block])
      return Error{ErrorKind::kBadInput, "the recording has changed while it was looked at", "",
                   "open it again when nothing writes to it"};
    return ticks;
  }

  const RecordingSource source_;
  const std::vector<double> begins_s_;  // time of each block's first tick

  mutable std::mutex mutex_;  // of what follows
  std::condition_variable wanted_changed_;
  std::list<Kept> kept_;
  std::size_t wanted_ = 0;
  int way_ = 0;
  std::optional<Error> failure_;

  std::atomic<bool> ending_{false};
  std::thread reader_;
};

class Playback final : public ViewerHost {
 public:
  Playback(RecordingSource recording, std::shared_ptr<const Model> model, ViewedScene scene,
           std::vector<double> begins_s, std::vector<ModelChange> changes)
      : header_(recording.head().header),
        model_(std::move(model)),
        scene_(std::move(scene)),
        changes_(std::move(changes)),
        place_(scene_.recording->begin_s, scene_.recording->end_s),
        blocks_(std::move(recording), std::move(begins_s)) {}

  const ViewedScene& scene() const override { return scene_; }

  TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const override {
    const std::lock_guard lock(mutex_);
    const double at_s = place_.now_s();
    const int way = !place_.playing() ? 0 : place_.speed() > 0 ? 1 : -1;
    if (auto tick = blocks_.tick_at(at_s, way)) shown_ = *tick;
    stiffness_N_per_mm = {};
    // what the other methods make of it depends on the stiffest of all tissues
    if (shown_.method != static_cast<std::uint8_t>(ForceMethod::kProxy)) return shown_;
    const auto tissues = tissues_at(shown_.model_version);
    for (std::size_t d = 0; d < static_cast<std::size_t>(shown_.devices); ++d) {
      const DeviceTick& device = shown_.device[d];
      const int tissue =
          device.label < model_->tissue_of_label.size() ? model_->tissue_of_label[device.label] : -1;
      if (device.label != 0 && tissue >= 0)
        stiffness_N_per_mm[d] =
            felt_by_proxy_N_per_mm(tissues[static_cast<std::size_t>(tissue)].stiffness_N_per_mm, device);
    }
    return shown_;
  }
  ViewedHealth health() const override {
    ViewedHealth health;
    health.rate_hz = header_.rate_hz;
    return health;
  }
  ViewedState state() const override {
    const std::lock_guard lock(mutex_);
    ViewedState state;
    const auto method = std::min<std::size_t>(shown_.method, kForceMethods.size() - 1);
    state.method = kForceMethods[method].name;
    state.friction = shown_.switches & kSwitchFriction;
    state.viscosity = shown_.switches & kSwitchViscosity;
    state.passivity = shown_.switches & kSwitchPassivity;
    state.paused = shown_.switches & kSwitchPaused;
    state.max_force_N = shown_.max_force_N;
    state.rotation_wxyz = shown_.rotation_target_wxyz;
    state.model_version = shown_.model_version;
    state.tissues = tissues_at(shown_.model_version);
    state.playback = {place_.playing(), place_.speed(), blocks_.failure()};
    return state;
  }

  Result<void> play(const PlayRequest& request) override {
    const std::lock_guard lock(mutex_);
    place_.follow(request);
    blocks_.try_again();
    return {};
  }
  void emergency_stop(const ViewerIdentity& /*by*/) override {
    const std::lock_guard lock(mutex_);
    place_.stop();
  }

  Result<Grant> set(const SettingsRequest& /*request*/) override { return is_a_recording(); }
  Result<Grant> set(const TissueRequest& /*request*/) override { return is_a_recording(); }
  Result<void> rearm(const RearmRequest& /*request*/) override { return is_a_recording(); }
  Result<void> take_pointer(bool take, const ViewerIdentity& /*by*/) override {
    return take ? Result<void>(is_a_recording()) : Result<void>();
  }
  void move_pointer(const std::array<double, 3>& /*tip_patient_mm*/) override {}
  std::vector<LateAnswer> take_answers() override { return {}; }
  void forget(const ViewerIdentity& /*viewer*/) override {}

 private:
  // as the changes left them that had led to that version
  std::vector<ViewedTissueState> tissues_at(std::uint32_t version) const {
    auto tissues = viewed_tissues(*model_);
    for (const ModelChange& change : changes_)
      if (change.version <= version && change.tissue < tissues.size())
        tissues[change.tissue] = {change.stiffness_N_per_mm, change.static_friction, change.dynamic_friction,
                                  change.viscosity_N_s_per_mm};
    return tissues;
  }

  const RecordingHeader header_;
  const std::shared_ptr<const Model> model_;
  const ViewedScene scene_;
  const std::vector<ModelChange> changes_;

  mutable std::mutex mutex_;  // of what follows
  mutable Place place_;
  mutable TickRecord shown_;
  mutable Blocks blocks_;
};

}  // namespace

Result<std::unique_ptr<ViewerHost>> open_playback(RecordingSource recording,
                                                  std::shared_ptr<const Model> model, Modality modality,
                                                  const Progress& progress) {
  const RecordingHead& head = recording.head();
  if (auto same = check_recorded_model(head.header, *model); !same) return same.error();
  if (head.ticks == 0)
    return Error{ErrorKind::kBadInput, "the recording has no ticks", "", "record for longer than an instant"};
  if (!head.clock_rises)
    return Error{ErrorKind::kBadInput,
                 "the recording's clock does not rise, so that there is no time to look at", "",
                 "palpate replay without --view compares its ticks"};

  RecordingLine line(head);
  std::vector<double> begins_s;
  std::vector<ModelChange> changes;
  std::uint64_t row = 0;
  const auto seen = recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        progress.report("looking through the recording",
                        static_cast<double>(row) / static_cast<double>(head.ticks));
        line.see(part);
        for (const RecordingEvent& event : part.events)
          if (event.kind == RecordingEvent::Kind::kModel) changes.push_back(event.change);
        for (const TickRecord& tick : part.ticks)
          if (row++ % kBlockTicks == 0) begins_s.push_back(tick.time_s);
        return {};
      },
      progress);
  if (!seen) return seen.error();
  progress.report("looking through the recording", 1);

  ViewedScene scene = viewed_scene(*model, modality);
  scene.recording = line.take();
  scene.device_name = head.header.device.empty() ? "recorded" : head.header.device;
  scene.input = "recording";
  scene.rate_hz = head.header.rate_hz;
  for (const RecordingHead::FeltMethod& felt : head.methods)
    if (felt.method < kForceMethods.size()) scene.methods.emplace_back(kForceMethods[felt.method].name);
  try {
    return std::unique_ptr<ViewerHost>(std::make_unique<Playback>(
        std::move(recording), std::move(model), std::move(scene), std::move(begins_s), std::move(changes)));
  } catch (const std::system_error&) {
    return Error{ErrorKind::kUnavailable, "there is no thread to be had to read the recording", "",
                 "end other programs"};
  }
}

}  // namespace palpate
