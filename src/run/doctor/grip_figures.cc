#include <charconv>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

#include "palpate/base/printable.h"
#include "palpate/device/bounds.h"
#include "palpate/doctor/grip_trial.h"

namespace palpate {
namespace {

// plausible range of trial results: stiffness, latency, and loop rates of 250 Hz and more
constexpr double kMinStable_N_per_mm = 1e-3, kMaxStable_N_per_mm = 5, kMaxMeasuredDelay_s = 0.02;
constexpr double kMinRate_hz = 250, kMaxRate_hz = 20'000;
// tolerance for a session's rate that is not fully reached
constexpr double kRatePlay = 0.9;

// next word of a line, which is removed from it
std::string_view word_of(std::string_view& line) {
  const std::size_t end = std::min(line.find(' '), line.size());
  const std::string_view word = line.substr(0, end);
  line.remove_prefix(std::min(end + 1, line.size()));
  return word;
}

std::optional<double> number_of(std::string_view word, double smallest, double largest) {
  double value = 0;
  const auto [end, failed] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (failed != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value >= smallest && value <= largest ? std::optional(value) : std::nullopt;
}

std::optional<GripTrialFigures> figures_of(std::string_view line) {
  GripTrialFigures figures;
  const auto rate_hz = number_of(word_of(line), kRatePlay * kMinRate_hz, kMaxRate_hz),
             delay_s = number_of(word_of(line), 0, kMaxMeasuredDelay_s),
             stable_N_per_mm = number_of(word_of(line), kMinStable_N_per_mm, kMaxStable_N_per_mm);
  const std::string_view swings_word = word_of(line);
  const auto swings = number_of(swings_word, kMinStable_N_per_mm, kMaxStable_N_per_mm);
  if (!rate_hz || !delay_s || !stable_N_per_mm || (!swings && swings_word != "-") || line.empty())
    return std::nullopt;
  // grip_figures_text() does not write such a line
  if (swings.value_or(*stable_N_per_mm) < *stable_N_per_mm || printable_name(line) != line)
    return std::nullopt;
  figures = {std::string(line), *rate_hz, *delay_s,
             *stable_N_per_mm,  swings,   kStiffnessMargin * swings.value_or(*stable_N_per_mm)};
  return figures;
}

class DriverWithGripFigures final : public DeviceDriver {
 public:
  DriverWithGripFigures(std::unique_ptr<DeviceDriver> driver, GripFiguresByDevice figures, double rate_hz)
      : driver_(std::move(driver)), figures_(std::move(figures)), rate_hz_(rate_hz) {
    apply_figures();
  }
  std::span<const DeviceInfo> devices() const override { return infos_; }
  std::size_t clock_owner() const override { return driver_->clock_owner(); }
  Result<void> open(bool may_move) override {
    if (auto opened = driver_->open(may_move); !opened) return opened.error();
    apply_figures();
    return {};
  }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override { driver_->run(servo, clock); }
  void halt() noexcept override { driver_->halt(); }
  void resume(std::uint64_t newest) noexcept override { driver_->resume(newest); }
  int halt_fd() const noexcept override { return driver_->halt_fd(); }
  std::optional<Error> failure() const override { return driver_->failure(); }

 private:
  void apply_figures() {
    const auto devices = driver_->devices();
    infos_.assign(devices.begin(), devices.end());
    for (DeviceInfo& info : infos_) {
      const auto measured = figures_.find(printable_name(info.name));
      if (measured == figures_.end() || info.simulated) continue;
      const double rate_hz = info.drive == DeviceInfo::Drive::kPulled ? rate_hz_ : info.rate_hz.value_or(0);
      if (rate_hz < kRatePlay * measured->second.rate_hz) continue;
      const double advised = measured->second.recommended_N_per_mm;
      info.delay_s = std::max(measured->second.delay_s, info.delay_s.value_or(0));
      info.stiffness_N_per_mm = std::min(advised, info.stiffness_N_per_mm.value_or(advised));
    }
  }

  const std::unique_ptr<DeviceDriver> driver_;
  const GripFiguresByDevice figures_;
  const double rate_hz_;
  std::vector<DeviceInfo> infos_;
};

}  // namespace

std::string grip_figures_text(const GripFiguresByDevice& hands) {
  std::string text =
      "# Stable stiffness of each device, measured by palpate doctor --hold and used by palpate explore.\n"
      "# rate_hz delay_s held_N_per_mm swings_N_per_mm|- NAME\n";
  for (const auto& [name, figures] : hands) {
    char line[160];
    std::snprintf(line, sizeof line, "%.6g %.6f %.6g ", figures.rate_hz, figures.delay_s,
                  figures.stable_N_per_mm);
    text += line;
    if (figures.oscillating_N_per_mm)
      std::snprintf(line, sizeof line, "%.6g ", *figures.oscillating_N_per_mm);
    text += (figures.oscillating_N_per_mm ? line : "- ") + printable_name(name) + "\n";
  }
  return text;
}

Result<GripFiguresByDevice> parse_grip_figures(std::string_view text, const std::string& where) {
  GripFiguresByDevice hands;
  int number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++number;
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() || line[0] == '#') continue;
    const auto bad = [&](const char* what) {
      return Error{ErrorKind::kBadInput, what, where + ":" + std::to_string(number),
                   "run palpate doctor --hold NAME again, or remove the line"};
    };
    auto figures = figures_of(line);
    if (!figures) return bad("is not a valid measurement");
    const std::string name = figures->device;
    if (!hands.emplace(name, *std::move(figures)).second) return bad("repeats a device");
  }
  return hands;
}

std::unique_ptr<DeviceDriver> with_grip_figures(std::unique_ptr<DeviceDriver> driver,
                                                GripFiguresByDevice hands, double rate_hz) {
  return std::make_unique<DriverWithGripFigures>(std::move(driver), std::move(hands), rate_hz);
}

}  // namespace palpate
