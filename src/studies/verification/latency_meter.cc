#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

#include "palpate/base/clock.h"
#include "palpate/base/latency_histogram.h"
#include "palpate/recording/recorder.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/empty_loop.h"
#include "palpate/servo/loop_statistics.h"
#include "palpate/verification/servo_timing.h"

namespace palpate {
namespace {

constexpr double kWarmUp_s = 0.2;
// wake-up interval of the calling thread, in both kinds of block
constexpr auto kMeterPoll = std::chrono::milliseconds(5);
// lead time of the commanded hand positions, so that the hand never waits for the calling thread
constexpr double kAhead_s = 0.02;

// resolution limit of the clock
constexpr double kMin_us = 1e-3;

LatenessPair pair_of(double servo_us, double bare_us) {
  return {servo_us, std::max(bare_us, kMin_us)};
}

// pair at a quantile of the ratios, rounded up; zeros if there are none
LatenessPair pair_at(std::vector<LatenessPair> pairs, double part) {
  if (pairs.empty()) return {};
  const auto index = pairs.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(pairs.size()));
  std::nth_element(pairs.begin(), index, pairs.end(), [](const LatenessPair& a, const LatenessPair& b) {
    return a.servo_us * b.bare_us < b.servo_us * a.bare_us;
  });
  return *index;
}

// The proxy only couples to a tip that has been in free space, so a stroke starts this long before contact.
constexpr double kLeadIn_s = 0.1;

// moves a hand along the contact part of a path, back and forth, in real time
class Stroke {
 public:
  static Point<World> start(const PalpationPath& path) {
    return path.intended[path.touch_begin - lead_in(path)];
  }
  Stroke(const PalpationPath& path, SimulatedDriver& driver, const WorkspaceMapping& mapping)
      : path_(path), driver_(driver), mapping_(mapping), start_ns_(monotonic_ns()) {}

  // returns false if interrupted
  bool keep_on_for(double seconds, const Progress& progress) {
    const std::int64_t end_ns = monotonic_ns() + to_ns(seconds);
    while (monotonic_ns() < end_ns) {
      if (progress.stopped()) return false;
      const std::int64_t at_ns = monotonic_ns() + to_ns(kAhead_s);
      driver_.intend(mapping_.to_device(requested_at(at_ns)), at_ns);
      std::this_thread::sleep_for(kMeterPoll);
    }
    return true;
  }

 private:
  static std::size_t lead_in(const PalpationPath& path) {
    return std::min(path.touch_begin, static_cast<std::size_t>(kLeadIn_s * path.rate_hz));
  }

  Point<World> requested_at(std::int64_t time_ns) const {
    const std::size_t length = path_.touch_end - path_.touch_begin, lead = lead_in(path_);
    const auto passed =
        static_cast<std::size_t>(static_cast<double>(time_ns - start_ns_) * 1e-9 * path_.rate_hz);
    if (passed < lead) return path_.intended[path_.touch_begin - lead + passed];
    const std::size_t direction = (passed - lead) % (2 * length);
    return path_.intended[path_.touch_begin + (direction < length ? direction : 2 * length - 1 - direction)];
  }

  const PalpationPath& path_;
  SimulatedDriver& driver_;
  const WorkspaceMapping& mapping_;
  const std::int64_t start_ns_;
};

class Meter final : public PaceMeter {
 public:
  Meter(std::shared_ptr<const Model> model, const PalpationPath& path, const PaceSettings& settings)
      : model_(std::move(model)), path_(path), settings_(settings) {
    PALPATE_CHECK(path.touch_begin < path.touch_end && path.touch_end <= path.intended.size());
  }

  Result<void> servo_block(double seconds, const Progress& progress) override;
  Result<void> bare_block(double seconds, const Progress& progress) override;
  PaceFigures figures() const override;

 private:
  void observe(const TickRecord& record);
  void pair_blocks();
  void add_health(const LoopHealth& health);

  const std::shared_ptr<const Model> model_;
  const PalpationPath& path_;
  const PaceSettings settings_;
  std::atomic<bool> counting_{false};

  LatencyHistogram compute_, lateness_, bare_lateness_;
  LatencyHistogram servo_block_, bare_block_;  // the latest of each, until they form a pair
  std::uint64_t ticks_ = 0, touching_ = 0;
  double on_time_ticks_ = 0, due_ticks_ = 0;
  std::vector<LatenessPair> pairs_p50_, pairs_p99_;
  PaceFigures sums_;
};

Result<void> Meter::servo_block(double seconds, const Progress& progress) {
  SimulatedDevice device(path_.device, path_.hand);
  const WorkspaceMapping mapping(device.info(), path_.workspace);
  device.reset(mapping.to_device(Stroke::start(path_)));
  SimulatedDriver driver(device);

  LoopSettings loop_settings;
  loop_settings.rate_hz = settings_.rate_hz;
  loop_settings.spin_s = settings_.spin_s;
  loop_settings.realtime = settings_.realtime;
  loop_settings.cpu = settings_.cpu;
  auto started = ServoLoop::start(model_, driver, path_.parameters, {path_.workspace}, loop_settings);
  if (!started) return started.error();
  ServoLoop& loop = **started;
  sums_.scheduling = loop.scheduling();

  RecordingHeader header;
  header.rate_hz = settings_.rate_hz;
  header.clock = "real";
  counting_ = false;
  servo_block_.clear();
  auto recorder =
      Recorder::start(loop.ring(), "", header,
                      [this](const TickRecord& record, std::span<const RecordingEvent>) { observe(record); });
  if (!recorder) return recorder.error();

  Stroke stroke(path_, driver, mapping);
  bool whole = stroke.keep_on_for(kWarmUp_s, progress);
  loop.reset_health();
  counting_ = true;
  whole = whole && stroke.keep_on_for(seconds, progress);
  counting_ = false;
  const LoopHealth health = loop.health();
  loop.stop();
  // joins the recorder's thread, so that its counters can be read
  recorder->reset();
  if (!whole) return Progress::interrupted();
  lateness_.merge(servo_block_);
  add_health(health);
  pair_blocks();
  return {};
}

// called on the recorder's thread
void Meter::observe(const TickRecord& record) {
  if (!counting_) return;
  compute_.add(to_ns(record.compute_s));
  servo_block_.add(to_ns(record.lateness_s));
  touching_ += (record.device[0].flags & kFlagContact) != 0;
  ++ticks_;
}

void Meter::add_health(const LoopHealth& health) {
  sums_.skipped += health.skipped;
  sums_.dropped += health.dropped;
  sums_.late = sums_.late + health.late;
  const auto due = static_cast<double>(health.ticks + health.skipped);
  on_time_ticks_ += health.on_time * due;
  due_ticks_ += due;
}

Result<void> Meter::bare_block(double seconds, const Progress& progress) {
  RealtimeRequest request;
  request.fifo = request.lock_memory = settings_.realtime;
  request.cpu = settings_.cpu;
  bare_block_.clear();
  const auto bare =
      measure_empty_loop(settings_.rate_hz, seconds, settings_.spin_s, request, bare_block_, progress);
  if (!bare) return bare.error();
  bare_lateness_.merge(bare_block_);
  sums_.bare_ticks += bare->ticks;
  sums_.bare_skipped += bare->skipped;
  pair_blocks();
  return {};
}

void Meter::pair_blocks() {
  if (servo_block_.summary().n == 0 || bare_block_.summary().n == 0) return;
  const Percentiles servo = percentiles_of(servo_block_), bare = percentiles_of(bare_block_);
  pairs_p50_.push_back(pair_of(servo.p50_us, bare.p50_us));
  pairs_p99_.push_back(pair_of(servo.p99_us, bare.p99_us));
  servo_block_.clear();
  bare_block_.clear();
}

PaceFigures Meter::figures() const {
  PaceFigures figures = sums_;
  figures.compute = percentiles_of(compute_);
  figures.lateness = percentiles_of(lateness_);
  figures.bare_lateness = percentiles_of(bare_lateness_);
  figures.typical_p50 = pair_at(pairs_p50_, 0.5);
  figures.typical_p99 = pair_at(pairs_p99_, 0.5);
  figures.min_p50 = pair_at(pairs_p50_, 0.25);
  figures.min_p99 = pair_at(pairs_p99_, 0.25);
  figures.ticks = ticks_;
  if (ticks_ > 0) figures.in_contact = static_cast<double>(touching_) / static_cast<double>(ticks_);
  if (due_ticks_ > 0) figures.on_time = on_time_ticks_ / due_ticks_;
  return figures;
}

}  // namespace

std::unique_ptr<PaceMeter> PaceMeter::create(std::shared_ptr<const Model> model, const PalpationPath& path,
                                             const PaceSettings& settings) {
  return std::make_unique<Meter>(std::move(model), path, settings);
}

}  // namespace palpate
