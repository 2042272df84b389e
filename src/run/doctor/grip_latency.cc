#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "doctor/grip_trial_servo.h"

namespace palpate {
namespace {

constexpr double kWindow_s = 0.5, kMaxDelay_s = 0.02, kDelayStep_s = 0.25e-3;
// interval of the displacement from which the direction of motion is taken
constexpr double kDirection_s = 0.008;
// a latency is accepted if the residual of others at least kOtherDelay_s away is larger by the factor
// kClearly
constexpr double kOtherDelay_s = 0.0015, kClearly = 1.5;

// second time integral of the force, which is held constant between ticks and acts delay_s later
class DoubleIntegral {
 public:
  DoubleIntegral(const std::vector<PushedTick>& ticks, std::size_t from, std::size_t to, double delay_s) {
    const double started_s = ticks[from].time_s;
    double once = 0, twice = 0, last_s = started_s;
    // forces commanded before the window act within it
    std::size_t acting = 0;
    const auto force_at = [&](double time_s) {
      while (acting + 1 < ticks.size() && ticks[acting + 1].time_s + delay_s <= time_s) ++acting;
      return ticks[acting].time_s + delay_s <= time_s ? ticks[acting].force_N : 0.0;
    };
    for (std::size_t n = from; n < to; ++n) {
      // split the tick at every change of the delayed force
      while (last_s < ticks[n].time_s) {
        const double force_N = force_at(last_s);
        double next_s = ticks[n].time_s;
        if (acting + 1 < ticks.size())
          next_s =
              std::clamp(ticks[acting + 1].time_s + delay_s, last_s + 1e-9, std::max(next_s, last_s + 1e-9));
        next_s = std::min(next_s, ticks[n].time_s);
        const double dt = next_s - last_s;
        if (!(dt > 0)) break;
        twice += once * dt + 0.5 * force_N * dt * dt;
        once += force_N * dt;
        last_s = next_s;
      }
      last_s = ticks[n].time_s;
      values_.push_back(twice);
    }
  }
  const std::vector<double>& values() const { return values_; }

 private:
  std::vector<double> values_;
};

// first and second time integral, by the trapezoidal rule
struct Integrals {
  std::vector<double> once, twice;
  Integrals(const std::vector<PushedTick>& ticks, std::size_t from, std::size_t to,
            const std::vector<double>& values) {
    double first = 0, second = 0;
    for (std::size_t n = from; n < to; ++n) {
      if (n > from) {
        const double dt = ticks[n].time_s - ticks[n - 1].time_s;
        const double mean = 0.5 * (values[n] + values[n - 1]);
        second += first * dt + 0.5 * mean * dt * dt;
        first += mean * dt;
      }
      once.push_back(first);
      twice.push_back(second);
    }
  }
};

// Direction of motion at each tick, -1 ... 1, i.e. that of dry friction, from the displacement over an
// interval around the tick. A displacement below an encoder step counts as rest.
std::vector<double> directions(const std::vector<PushedTick>& ticks, double step_m) {
  std::vector<double> found(ticks.size(), 0.0);
  std::size_t before = 0, after = 0;
  for (std::size_t n = 0; n < ticks.size(); ++n) {
    while (ticks[before].time_s < ticks[n].time_s - kDirection_s) ++before;
    while (after + 1 < ticks.size() && ticks[after].time_s < ticks[n].time_s + kDirection_s) ++after;
    found[n] = std::clamp((ticks[after].tip_m - ticks[before].tip_m) / (1.5 * step_m), -1.0, 1.0);
  }
  return found;
}

/// A window of the motion, with the terms of its equation that do not depend on the latency.
class Window {
 public:
  Window(const std::vector<PushedTick>& ticks, const std::vector<double>& directions, std::size_t from,
         std::size_t to)
      : ticks_(ticks), from_(from), to_(to) {
    const auto size = static_cast<Eigen::Index>(to - from);
    std::vector<double> path(ticks.size());
    for (std::size_t n = from; n < to; ++n) path[n] = ticks[n].tip_m - ticks[from].tip_m;
    const Integrals of_path(ticks, from, to, path), of_direction(ticks, from, to, directions);
    terms_.resize(size, 7);
    path_.resize(size);
    for (Eigen::Index i = 0; i < size; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double t = ticks[from + k].time_s - ticks[from].time_s;
      // constant, linear and quadratic terms account for the initial state and the spring's rest position
      terms_.row(i) << 0, of_path.once[k], of_path.twice[k], of_direction.twice[k], 1, t, t * t;
      path_[i] = path[from + k];
    }
    normalise(terms_.rightCols(6));
  }
  /// Residual sum of squares of a fit with this latency, m^2.
  double residual_m2(double delay_s) {
    const auto force = DoubleIntegral(ticks_, from_, to_, delay_s).values();
    terms_.col(0) = Eigen::Map<const Eigen::VectorXd>(force.data(), static_cast<Eigen::Index>(force.size()));
    normalise(terms_.leftCols(1));
    const Eigen::VectorXd fitted = terms_.colPivHouseholderQr().solve(path_);
    return (terms_ * fitted - path_).squaredNorm();
  }

 private:
  // scales the columns to unit norm
  static void normalise(Eigen::Ref<Eigen::MatrixXd> terms) {
    for (Eigen::Index c = 0; c < terms.cols(); ++c)
      if (const double size = terms.col(c).norm(); size > 0) terms.col(c) /= size;
  }

  const std::vector<PushedTick>& ticks_;
  std::size_t from_, to_;
  Eigen::MatrixXd terms_;
  Eigen::VectorXd path_;
};

}  // namespace

std::optional<double> delay_of(const std::vector<PushedTick>& ticks, double step_m) {
  const std::vector<double> directed = directions(ticks, step_m);
  std::vector<Window> windows;
  for (std::size_t from = 0, n = 0; n < ticks.size(); ++n)
    if (ticks[n].time_s - ticks[from].time_s >= kWindow_s) {
      windows.emplace_back(ticks, directed, from, n);
      from = n;
    }
  std::vector<double> residuals_m2;
  for (int d = 0; d * kDelayStep_s <= kMaxDelay_s; ++d) {
    residuals_m2.push_back(0);
    for (Window& window : windows) residuals_m2.back() += window.residual_m2(d * kDelayStep_s);
  }
  const auto best = std::ranges::min_element(residuals_m2);
  const auto index = best - residuals_m2.begin();
  double others = std::numeric_limits<double>::infinity();
  for (std::ptrdiff_t d = 0; d < std::ssize(residuals_m2); ++d)
    if (static_cast<double>(std::abs(d - index)) * kDelayStep_s >= kOtherDelay_s)
      others = std::min(others, residuals_m2[static_cast<std::size_t>(d)]);
  if (!(others > kClearly * *best)) return std::nullopt;
  return static_cast<double>(index) * kDelayStep_s;
}

}  // namespace palpate
