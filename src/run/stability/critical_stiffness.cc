#include "palpate/stability/critical_stiffness.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <deque>
#include <iterator>
#include <mutex>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "palpate/cache/entries.h"
#include "stability/critical_stiffness_hold.h"

namespace palpate {
namespace {

constexpr double kMinRate_hz = 100, kMaxRate_hz = 20000;
// the fastest impact first, since it usually decides
constexpr double kImpacts_m_s[] = {0.5, 0.1, 0};
constexpr double kStep = 1.05;
constexpr int kCoarse = 4;  // steps at a time until the first failure
// the search begins at this fraction of the theoretical stiffness without friction, and goes down if that
// fails
constexpr double kStartOfTheory = 0.25;
constexpr double kSoftest_N_per_mm = 1e-3;

using Fails = bool (*)(const StabilityCase& stability_case, double stiffness_N_per_mm, double impact_m_s);

std::optional<Error> fault_of(const StabilityCase& stability_case) {
  const auto bad = [](const std::string& what, const std::string& remedy) {
    return Error{ErrorKind::kBadInput, what, "", remedy};
  };
  // written such that NaN is out of range
  if (!(stability_case.rate_hz >= kMinRate_hz && stability_case.rate_hz <= kMaxRate_hz))
    return bad("the stiffness cannot be determined at this rate", "choose from 100 to 20000 Hz");
  if (!(stability_case.delay_s >= 0 && stability_case.delay_s <= SimulatedDevice::kMaxDelay_s))
    return bad("the stiffness cannot be determined with this delay", "choose from 0 to 20 ms");
  if (!(stability_case.device.mass_kg + stability_case.hand.mass_kg > 0))
    return bad("device and hand have no mass", "give at least one of them a mass");
  if (!(stability_case.hand.stiffness_N_per_m > 0))
    return bad("the hand '" + stability_case.hand.name + "' has no stiffness", "give it a stiffness");
  if (!(stability_case.device.encoder_step_m > 0))
    return bad(
        "the device '" + stability_case.device.name + "' has no encoder step to measure a limit cycle by",
        "give it one");
  return std::nullopt;
}

// coarse steps upwards until an impact fails, then fine steps from the last stable value
Result<double> stiffest_before(Fails fails, const StabilityCase& stability_case, const Progress& progress) {
  if (const auto fault = fault_of(stability_case)) return *fault;
  const auto any_fails = [&](double stiffness_N_per_mm) {
    return std::any_of(std::begin(kImpacts_m_s), std::end(kImpacts_m_s), [&](double impact_m_s) {
      return fails(stability_case, stiffness_N_per_mm, impact_m_s);
    });
  };
  const double theory = theoretical_stiffness_N_per_mm(
      stability_case.device.damping_N_s_per_m + stability_case.hand.damping_N_s_per_m, stability_case.rate_hz,
      stability_case.delay_s);
  double stiffness = std::clamp(kStartOfTheory * theory, kSoftest_N_per_mm, kStiffestWall_N_per_mm);
  while (any_fails(stiffness)) {
    if (progress.stopped()) return Progress::interrupted();
    if (stiffness <= kSoftest_N_per_mm) return 0.0;
    stiffness /= kStep;
  }
  for (const double step : {std::pow(kStep, kCoarse), kStep}) {
    while (stiffness < kStiffestWall_N_per_mm && !any_fails(stiffness * step)) {
      if (progress.stopped()) return Progress::interrupted();
      stiffness *= step;
    }
  }
  return std::min(stiffness, kStiffestWall_N_per_mm);
}

/// Constants of the loop that determine a recommended stiffness: the device's dynamics, tick rate and delay.
using LoopConstants = std::array<double, 7>;

LoopConstants constants_of(const PlantDevice& device, double rate_hz, double delay_s) {
  return {device.mass_kg,
          device.damping_N_s_per_m,
          device.coulomb_N,
          device.encoder_step_m,
          device.peak_force_N,
          rate_hz,
          delay_s};
}

/// Cache of recommended stiffnesses by loop constants, because a search simulates minutes of holds: the last
/// few in memory, all of them in the cache folder. Thread-safe.
class Recommendations {
 public:
  std::optional<double> find(const LoopConstants& loop) {
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [known, stiffness_N_per_mm] : known_)
        if (known == loop) return stiffness_N_per_mm;
    }
    const auto digest = key_of(loop);
    const auto payload = digest ? cache::find(*digest) : std::nullopt;
    double stiffness_N_per_mm = 0;
    if (!payload || payload->bytes().size() != sizeof stiffness_N_per_mm) return std::nullopt;
    std::memcpy(&stiffness_N_per_mm, payload->bytes().data(), sizeof stiffness_N_per_mm);
    keep(loop, stiffness_N_per_mm);
    return stiffness_N_per_mm;
  }
  void add(const LoopConstants& loop, double stiffness_N_per_mm) {
    keep(loop, stiffness_N_per_mm);
    if (const auto digest = key_of(loop))
      cache::store(*digest, std::as_bytes(std::span(&stiffness_N_per_mm, 1)));
  }

 private:
  static constexpr std::size_t kCapacity = 16;
  // incremented whenever the search, the grips or the simulated device change
  static constexpr std::uint32_t kVersion = 1;

  static std::optional<cache::Digest> key_of(const LoopConstants& loop) {
    if (!cache::is_cache_enabled()) return std::nullopt;
    cache::Key key("recommended stiffness", kVersion);
    for (const double constant : loop) key.put(constant);
    return key.digest();
  }
  void keep(const LoopConstants& loop, double stiffness_N_per_mm) {
    const std::lock_guard lock(mutex_);
    if (known_.size() == kCapacity) known_.pop_front();
    known_.emplace_back(loop, stiffness_N_per_mm);
  }

  std::mutex mutex_;
  std::deque<std::pair<LoopConstants, double>> known_;
};

}  // namespace

Result<double> critical_stiffness_N_per_mm(const StabilityCase& stability_case, const Progress& progress) {
  return stiffest_before(has_limit_cycle, stability_case, progress);
}

Result<double> settling_stiffness_N_per_mm(const StabilityCase& stability_case, const Progress& progress) {
  return stiffest_before(oscillates_after_a_second, stability_case, progress);
}

double passivity_bound_N_per_mm(const PlantDevice& device, double rate_hz) {
  PALPATE_CHECK(rate_hz > 0);
  const double sampling = 2 * device.damping_N_s_per_m * rate_hz;
  // without encoder steps there is no quantisation
  const double quantisation = 2 * device.coulomb_N / device.encoder_step_m;
  return (device.encoder_step_m > 0 ? std::min(sampling, quantisation) : sampling) * 1e-3;
}

double recommended_damping_N_s_per_mm(const PlantDevice& device, double rate_hz, double delay_s) {
  return kStiffnessMargin * neutral_damping_N_s_per_mm(device.mass_kg, rate_hz, delay_s);
}

const std::vector<PlantHand>& recommending_grips() {
  static const std::vector<PlantHand> grips = [] {
    std::vector<PlantHand> all{*find_plant_hand("light-grip"), *find_plant_hand("firm-grip")};
    std::ranges::copy_if(plant_hands_with_skin(), std::back_inserter(all),
                         [](const PlantHand& hand) { return hand.name != "fingertip"; });
    return all;
  }();
  return grips;
}

Result<double> recommended_stiffness_N_per_mm(const PlantDevice& device, double rate_hz, double delay_s,
                                              const Progress& progress) {
  static Recommendations recommendations;
  const LoopConstants loop = constants_of(device, rate_hz, delay_s);
  if (const auto known = recommendations.find(loop)) return *known;
  double smallest = kStiffestWall_N_per_mm;
  for (const PlantHand& grip : recommending_grips()) {
    const auto critical = critical_stiffness_N_per_mm({device, grip, rate_hz, delay_s}, progress);
    if (!critical) return critical;
    smallest = std::min(smallest, *critical);
  }
  recommendations.add(loop, kStiffnessMargin * smallest);
  return kStiffnessMargin * smallest;
}

}  // namespace palpate
