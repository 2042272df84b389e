#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <unsupported/Eigen/LevenbergMarquardt>
#include <unsupported/Eigen/NumericalDiff>

#include "indentation/format.h"
#include "palpate/indentation/indentation.h"

namespace palpate {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
/// Samples per curve above which only every n-th enters the fit.
constexpr std::size_t kMaxFitted = 4000;
/// Weights: the standard deviation of a sample is this fraction of its force plus this fraction of the
/// greatest force of its curve, times an unknown factor.
constexpr double kRelativeNoise = 1, kNoiseFloor = 0.05;
/// A law must reduce the sum of squares by this multiple of its mean square to replace a simpler one.
constexpr double kSignificant = 15;

// a curve's samples that enter the fit
struct Samples {
  IndentationSetup setup;
  std::vector<double> depth_mm, force_N, time_s, weight;
  double max_N = 0;
};

// quasi-linear viscoelasticity: subtracts from the force without relaxation each term's fraction of that
// force low-pass filtered with the term's time constant
void relax(const std::vector<double>& time_s, std::span<const RelaxationTerm> terms,
           std::vector<double>& force_N) {
  const std::vector<double> elastic_N = force_N;
  for (const RelaxationTerm& term : terms) {
    double lagging_N = 0;
    for (std::size_t n = 1; n < elastic_N.size(); ++n) {
      const double dt_s = time_s[n] - time_s[n - 1], slope = (elastic_N[n] - elastic_N[n - 1]) / dt_s;
      lagging_N = elastic_N[n] - slope * term.time_s +
                  (lagging_N - elastic_N[n - 1] + slope * term.time_s) * std::exp(-dt_s / term.time_s);
      force_N[n] -= term.fraction * lagging_N;
    }
  }
}

// Parameters: ln E, stiffening (exponential law), then ln of the odds of the fraction and ln of the time of
// each relaxation term, then the depth of first contact of each curve if it is fitted.
struct Parameters {
  TissueLaw law;
  std::size_t terms;
  bool find_contact;
  double poissons_ratio;

  std::size_t first_term() const { return law == TissueLaw::kExponential ? 2 : 1; }
  std::size_t first_contact() const { return first_term() + 2 * terms; }
  std::size_t count(std::size_t curves) const { return first_contact() + (find_contact ? curves : 0); }

  ElasticConstants constants(const Eigen::VectorXd& x) const {
    return {std::exp(std::clamp(x[0], -20.0, 20.0)), poissons_ratio,
            law == TissueLaw::kExponential ? std::clamp(x[1], 0.0, 2 * kMaxStiffening) : 0};
  }
  std::vector<RelaxationTerm> relaxation(const Eigen::VectorXd& x) const {
    std::vector<RelaxationTerm> series;
    for (std::size_t n = 0; n < terms; ++n) {
      const auto at = static_cast<Eigen::Index>(first_term() + 2 * n);
      series.push_back({1 / (1 + std::exp(-std::clamp(x[at], -20.0, 20.0))),
                        std::exp(std::clamp(x[at + 1], -10.0, 15.0))});
    }
    return series;
  }
  double contact_mm(const Eigen::VectorXd& x, std::size_t curve) const {
    return find_contact ? x[static_cast<Eigen::Index>(first_contact() + curve)] : 0;
  }
  std::vector<double> forces(const Eigen::VectorXd& x, const Samples& curve, std::size_t index) const {
    const ElasticConstants tissue = constants(x);
    const double contact = contact_mm(x, index);
    std::vector<double> force_N;
    for (const double depth_mm : curve.depth_mm)
      force_N.push_back(indentation_force_N(tissue, law, curve.setup, depth_mm - contact));
    if (terms > 0 && !curve.time_s.empty()) relax(curve.time_s, relaxation(x), force_N);
    return force_N;
  }
};

class Residuals : public Eigen::DenseFunctor<double> {
 public:
  Residuals(const Parameters& parameters, std::span<const Samples> curves, int samples)
      : DenseFunctor(static_cast<int>(parameters.count(curves.size())), samples),
        parameters_(&parameters),
        curves_(curves) {}

  int operator()(const Eigen::VectorXd& x, Eigen::VectorXd& residual) const {
    Eigen::Index row = 0;
    for (std::size_t c = 0; c < curves_.size(); ++c) {
      const std::vector<double> force_N = parameters_->forces(x, curves_[c], c);
      for (std::size_t n = 0; n < force_N.size(); ++n)
        residual[row++] = (force_N[n] - curves_[c].force_N[n]) * curves_[c].weight[n];
    }
    return 0;
  }

 private:
  const Parameters* parameters_;
  std::span<const Samples> curves_;
};

struct Solution {
  Eigen::VectorXd x, error;  ///< Parameters and their standard errors; infinite where not determined
  double residual_sum_of_squares = std::numeric_limits<double>::infinity();
};

Solution solve(const Parameters& parameters, std::span<const Samples> curves, int samples,
               const Eigen::VectorXd& start) {
  const Residuals residuals(parameters, curves, samples);
  Eigen::NumericalDiff<Residuals, Eigen::Central> slopes(residuals, 1e-10);
  Eigen::LevenbergMarquardt<decltype(slopes)> search(slopes);
  Solution found;
  found.x = start;
  search.setMaxfev(400);
  search.minimize(found.x);
  Eigen::VectorXd residual(samples);
  residuals(found.x, residual);
  found.residual_sum_of_squares = residual.squaredNorm();
  Eigen::MatrixXd jacobian(samples, start.size());
  slopes.df(found.x, jacobian);
  const Eigen::FullPivLU<Eigen::MatrixXd> normal(jacobian.transpose() * jacobian);
  found.error.setConstant(start.size(), std::numeric_limits<double>::infinity());
  if (!normal.isInvertible() || !std::isfinite(found.residual_sum_of_squares)) return found;
  const double variance =
      found.residual_sum_of_squares / std::max<double>(1, samples - static_cast<double>(start.size()));
  found.error = (normal.inverse().diagonal() * variance).cwiseMax(0).cwiseSqrt();
  return found;
}

class Fit {
 public:
  Fit(std::span<const IndentationCurve> curves, const FitOptions& options)
      : curves_(curves), options_(options) {}

  Result<TissueFit> run() {
    if (auto usable = select(); !usable) return usable.error();
    fit_.poissons_ratio = options_.poissons_ratio;
    const std::size_t terms = options_.relaxes ? relaxation_terms() : 0;
    for (const TissueLaw law : {TissueLaw::kElastic, TissueLaw::kNeoHookean, TissueLaw::kExponential})
      if (!options_.law || *options_.law == law) add(law, terms);
    return choose();
  }

 private:
  static Error undetermined(std::string what, std::string remedy) {
    return {ErrorKind::kBadInput, std::move(what), "", std::move(remedy)};
  }

  // samples that the model covers, thinned to a number that the fit handles
  Result<void> select() {
    if (curves_.empty()) return undetermined("no curve is given", "give at least one");
    for (const IndentationCurve& curve : curves_) {
      const std::string name = curve.name.empty() ? "the curve" : "the curve \"" + curve.name + "\"";
      const double limit_mm = indentation_limit_mm(curve.setup);
      const std::size_t stride = curve.depth_mm.size() / kMaxFitted + 1;
      Samples used{curve.setup, {}, {}, {}, {}, 0};
      double deepest_mm = 0;
      for (std::size_t n = 0; n < curve.depth_mm.size(); n += stride) {
        // without times the order does not matter, and samples before contact say nothing
        const bool in_contact = options_.find_contact || curve.depth_mm[n] > 0;
        if (curve.depth_mm[n] > limit_mm || (!in_contact && curve.time_s.empty())) {
          fit_.left_out += curve.depth_mm[n] > limit_mm;
          // relaxation depends on the whole past
          if (!curve.time_s.empty() && curve.depth_mm[n] > limit_mm) break;
          continue;
        }
        used.depth_mm.push_back(curve.depth_mm[n]);
        used.force_N.push_back(curve.force_N[n]);
        if (!curve.time_s.empty()) used.time_s.push_back(curve.time_s[n]);
        used.max_N = std::max(used.max_N, curve.force_N[n]);
        deepest_mm = std::max(deepest_mm, curve.depth_mm[n]);
      }
      constexpr std::size_t kMinSamples = 8;
      const auto in_contact =
          static_cast<std::size_t>(std::ranges::count_if(used.depth_mm, [](double mm) { return mm > 0; }));
      if (in_contact < kMinSamples)
        return undetermined(name + " has " + std::to_string(in_contact) + " samples in contact and within " +
                                printed("%.3g mm, up to which the model is valid", limit_mm),
                            "give at least 8, no deeper than 0.7 radii and 20 % of a layer's thickness");
      if (!(used.max_N > 0))
        return undetermined(name + " has no force above 0", "a force that resists the indenter is positive");
      std::size_t distinct = 0;
      std::vector<double> sorted = used.depth_mm;
      std::ranges::sort(sorted);
      double last_mm = -std::numeric_limits<double>::infinity();
      for (const double mm : sorted)
        if (mm > 0 && mm > last_mm + 0.02 * deepest_mm) {
          ++distinct;
          last_mm = mm;
        }
      constexpr std::size_t kMinDepths = 5;
      if (distinct < kMinDepths)
        return undetermined(name + " has only " + std::to_string(distinct) + " distinct depths",
                            "one depth fits any law: record the force while the indenter goes in");
      for (const double force_N : used.force_N)
        used.weight.push_back(1 / (kRelativeNoise * std::abs(force_N) + kNoiseFloor * used.max_N));
      samples_ += static_cast<int>(used.depth_mm.size());
      used_.push_back(std::move(used));
    }
    fit_.samples = static_cast<std::size_t>(samples_);
    if (fit_.left_out > 0)
      fit_.notes.push_back(std::to_string(fit_.left_out) +
                           " samples are deeper than the model is valid and were left out.");
    return {};
  }

  // longest part of a curve in which the depth stays within 2 % of its greatest one
  static std::pair<std::size_t, std::size_t> hold_of(const Samples& curve) {
    const double deepest_mm = *std::ranges::max_element(curve.depth_mm);
    std::pair<std::size_t, std::size_t> longest{0, 0};
    for (std::size_t begin = 0, n = 0; n <= curve.depth_mm.size(); ++n) {
      if (n < curve.depth_mm.size() && curve.depth_mm[n] >= 0.98 * deepest_mm) continue;
      if (n - begin > longest.second - longest.first) longest = {begin, n};
      begin = n + 1;
    }
    return longest;
  }

  // Number of relaxation terms to try. A hold is a long part of a curve at one depth.
  std::size_t relaxation_terms() {
    constexpr std::size_t kMinHold = 10;
    hold_s_ = 0;
    for (const Samples& curve : used_) {
      if (curve.time_s.empty()) continue;
      const auto [begin, end] = hold_of(curve);
      if (end - begin < kMinHold) continue;
      const double hold_s = curve.time_s[end - 1] - curve.time_s[begin];
      if (hold_s < 0.3 * (curve.time_s.back() - curve.time_s.front())) continue;
      hold_s_ = std::max(hold_s_, hold_s);
    }
    if (hold_s_ == 0)
      fit_.notes.emplace_back("No curve holds its depth, so that relaxation is not determined.");
    return hold_s_ > 0 ? kMaxRelaxationTerms : 0;
  }

  Solution solve_from_starts(const Parameters& parameters) const {
    const auto count = static_cast<Eigen::Index>(parameters.count(used_.size()));
    Solution best;
    for (const double stiffening : {3.0, 20.0}) {
      if (stiffening > 3 && parameters.law != TissueLaw::kExponential) break;
      Eigen::VectorXd x = Eigen::VectorXd::Zero(count);
      if (parameters.law == TissueLaw::kExponential) x[1] = stiffening;
      for (std::size_t n = 0; n < parameters.terms; ++n) {
        const auto at = static_cast<Eigen::Index>(parameters.first_term() + 2 * n);
        x[at] = -1.5;
        x[at + 1] = std::log(hold_s_ * (n == 0 ? 0.1 : 0.5));
      }
      for (std::size_t c = 0; c < used_.size(); ++c)
        if (parameters.find_contact)
          x[static_cast<Eigen::Index>(parameters.first_contact() + c)] = first_contact_mm(used_[c]);
      // the force is proportional to the modulus: the ratio of these weighted scalar products is the
      // least-squares modulus
      double measured_by_unit = 0, unit_by_unit = 0;
      for (std::size_t c = 0; c < used_.size(); ++c) {
        const std::vector<double> unit_N = parameters.forces(x, used_[c], c);
        for (std::size_t n = 0; n < unit_N.size(); ++n) {
          const double w = used_[c].weight[n] * used_[c].weight[n];
          measured_by_unit += w * unit_N[n] * used_[c].force_N[n];
          unit_by_unit += w * unit_N[n] * unit_N[n];
        }
      }
      x[0] = std::log(measured_by_unit > 0 && unit_by_unit > 0 ? measured_by_unit / unit_by_unit : 1e-3);
      Solution found = solve(parameters, used_, samples_, x);
      if (found.residual_sum_of_squares < best.residual_sum_of_squares || best.x.size() == 0)
        best = std::move(found);
    }
    return best;
  }

  // initial guess of the depth of first contact: smallest depth with more than 5 % of the maximum force, less
  // a tenth of the indentation from there on
  static double first_contact_mm(const Samples& curve) {
    double first_mm = *std::ranges::max_element(curve.depth_mm);
    const double deepest_mm = first_mm;
    for (std::size_t n = 0; n < curve.depth_mm.size(); ++n)
      if (curve.force_N[n] > 0.05 * curve.max_N) first_mm = std::min(first_mm, curve.depth_mm[n]);
    return first_mm - 0.1 * (deepest_mm - first_mm);
  }

  void add(TissueLaw law, std::size_t most_terms) {
    Parameters parameters{law, 0, options_.find_contact, options_.poissons_ratio};
    Solution found = solve_from_starts(parameters);
    // a term of relaxation is kept if it explains more and is determined
    for (std::size_t terms = 1; terms <= most_terms; ++terms) {
      Parameters more = parameters;
      more.terms = terms;
      const Solution next = solve_from_starts(more);
      if (!improves(found.residual_sum_of_squares, next.residual_sum_of_squares) ||
          !relaxation_is_determined(more, next))
        break;
      parameters = more;
      found = next;
    }
    fit_.laws.push_back(law_fit(parameters, found));
    squares_.push_back(found.residual_sum_of_squares);
  }

  bool improves(double residual_sum_of_squares, double by) const {
    return (residual_sum_of_squares - by) * samples_ > kSignificant * by;
  }

  bool relaxation_is_determined(const Parameters& parameters, const Solution& found) const {
    for (const auto& [fraction, time] : relaxation_of(parameters, found))
      if (!(time.value <= hold_s_ && time.high <= 4 * time.low &&
            fraction.high - fraction.low < fraction.value && time.value >= kRelaxationTimeRange.min_s &&
            time.value <= kRelaxationTimeRange.max_s))
        return false;
    double sum = 0;
    for (const auto& [fraction, time] : relaxation_of(parameters, found)) sum += fraction.value;
    return sum < 1;
  }

  static std::vector<std::array<FittedValue, 2>> relaxation_of(const Parameters& parameters,
                                                               const Solution& found) {
    std::vector<std::array<FittedValue, 2>> terms;
    const auto series = parameters.relaxation(found.x);
    for (std::size_t n = 0; n < series.size(); ++n) {
      const auto at = static_cast<Eigen::Index>(parameters.first_term() + 2 * n);
      const auto fraction = [&](double errors) {
        return 1 / (1 + std::exp(-(found.x[at] + errors * found.error[at])));
      };
      const double wider = std::exp(2 * found.error[at + 1]);
      terms.push_back({FittedValue{series[n].fraction, fraction(-2), fraction(2)},
                       FittedValue{series[n].time_s, series[n].time_s / wider, series[n].time_s * wider}});
    }
    std::ranges::sort(terms, {}, [](const auto& term) { return term[1].value; });
    return terms;
  }

  LawFit law_fit(const Parameters& parameters, const Solution& found) const {
    LawFit fit;
    fit.law = parameters.law;
    const ElasticConstants constants = parameters.constants(found.x);
    const double wider = std::exp(2 * found.error[0]), e = constants.youngs_modulus_kPa;
    fit.youngs_modulus_kPa = {e, e / wider, e * wider};
    if (parameters.law == TissueLaw::kExponential) {
      const double b = constants.stiffening;
      fit.stiffening = {b, std::max(0.0, b - 2 * found.error[1]), b + 2 * found.error[1]};
    }
    fit.relaxation = relaxation_of(parameters, found);
    double residual_sum_of_squares = 0;
    for (std::size_t c = 0; c < used_.size(); ++c) {
      fit.contact_mm.push_back(parameters.contact_mm(found.x, c));
      const std::vector<double> force_N = parameters.forces(found.x, used_[c], c);
      for (std::size_t n = 0; n < force_N.size(); ++n)
        residual_sum_of_squares += std::pow((force_N[n] - used_[c].force_N[n]) / used_[c].max_N, 2);
    }
    fit.rms_percent = 100 * std::sqrt(residual_sum_of_squares / samples_);
    fit.undetermined = why_undetermined(fit);
    return fit;
  }

  std::string why_undetermined(const LawFit& fit) const {
    const FittedValue &e = fit.youngs_modulus_kPa, &b = fit.stiffening;
    constexpr double kMaxRms_percent = 12;
    if (!(fit.rms_percent < kMaxRms_percent))
      return printed(
          "the residuals are %.3g %% of the greatest force, so that the law does not describe the data",
          fit.rms_percent);
    if (!(e.high <= 2 * e.low))
      return options_.find_contact
                 ? printed(
                       "Young's modulus (%.3g ... %.3g kPa) and the depth of first contact explain the same "
                       "data",
                       e.low, e.high)
                 : printed("Young's modulus lies anywhere between %.3g and %.3g kPa", e.low, e.high);
    if (!(e.value >= kElasticModulusRange.min_kPa && e.value <= kElasticModulusRange.max_kPa))
      return printed("Young's modulus would be %.3g kPa: are depths in mm and forces in N?", e.value);
    if (fit.law != TissueLaw::kExponential) return "";
    if (!(b.low > 0)) return printed("the stiffening may be 0 (up to %.3g)", b.high);
    if (!(b.high - b.low < b.value))
      return printed("the stiffening lies anywhere between %.3g and %.3g: the curves end too early", b.low,
                     b.high);
    if (!(b.value <= kMaxStiffening)) return printed("the stiffening would be %.3g, more than 100", b.value);
    return "";
  }

  Result<TissueFit> choose() {
    std::optional<std::size_t> chosen;
    for (std::size_t n = 0; n < fit_.laws.size(); ++n)
      if (fit_.laws[n].undetermined.empty() && (!chosen || improves(squares_[*chosen], squares_[n])))
        chosen = n;
    if (!chosen) {
      const LawFit& last = fit_.laws.size() == 1 ? fit_.laws[0] : fit_.laws[1];
      return undetermined("the data determine no tissue: " + last.undetermined,
                          fit_.laws.size() == 1
                              ? "leave out --law, or press deeper, with less noise, and from first contact on"
                              : "press deeper, with less noise, and from first contact on");
    }
    fit_.chosen = *chosen;
    return std::move(fit_);
  }

  std::span<const IndentationCurve> curves_;
  const FitOptions& options_;
  std::vector<Samples> used_;
  int samples_ = 0;
  double hold_s_ = 0;
  TissueFit fit_;
  std::vector<double> squares_;
};

}  // namespace

ElasticConstants LawFit::constants(double poissons_ratio) const {
  return {youngs_modulus_kPa.value, poissons_ratio, stiffening.value};
}

Result<TissueFit> fit_tissue(std::span<const IndentationCurve> curves, const FitOptions& options) {
  return Fit(curves, options).run();
}

std::vector<double> fitted_forces_N(const LawFit& fit, double poissons_ratio, const IndentationCurve& curve,
                                    std::size_t index) {
  const double limit_mm = indentation_limit_mm(curve.setup), contact_mm = fit.contact_mm[index];
  std::vector<double> force_N;
  for (const double depth_mm : curve.depth_mm)
    force_N.push_back(
        indentation_force_N(fit.constants(poissons_ratio), fit.law, curve.setup, depth_mm - contact_mm));
  if (!fit.relaxation.empty() && !curve.time_s.empty()) {
    std::vector<RelaxationTerm> terms;
    for (const auto& [fraction, time] : fit.relaxation) terms.push_back({fraction.value, time.value});
    relax(curve.time_s, terms, force_N);
  }
  for (std::size_t n = 0; n < force_N.size(); ++n)
    if (curve.depth_mm[n] > limit_mm) force_N[n] = kNan;
  return force_N;
}

}  // namespace palpate
