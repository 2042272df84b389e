#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "palpate/indentation/indentation.h"

namespace palpate::testing {

/// Forces of independent solutions: a rigid sphere on axisymmetric finite elements (9 nodes, large strains, a
/// true sphere, frictionless contact; tools/indentation_fe), of a neo-Hookean body or under Fung's law.
/// Forces over E* times the squared radius at depths of 0.1, 0.2, ... radii, on a plate to which the body is
/// bonded.
struct SolvedCurve {
  double poissons_ratio, stiffening, thicknesses_in_radii;
  std::vector<double> force;
};
inline const std::vector<SolvedCurve>& solved_curves() {
  // as printed by the tool for E = 1
  static const std::vector<SolvedCurve> curves{
      {0.45, 0, 12, {0.052912, 0.148964, 0.271991, 0.415033, 0.574031, 0.746240}},
      {0.45, 3, 12, {0.054779, 0.159919, 0.302225, 0.478098, 0.686175, 0.926057, 1.197410}},
      {0.45, 10, 12, {0.058825, 0.180811, 0.357694, 0.589522, 0.877050, 1.223572, 1.631457}},
      {0.45, 30, 12, {0.068021, 0.227317, 0.477306, 0.825246, 1.280442, 1.855870}},
      {0.45, 0, 2, {0.061437, 0.185494, 0.357512, 0.569877}},
      {0.45, 10, 2, {0.071019, 0.258039, 0.634900, 1.428947}},
      {0.45, 20, 6, {0.066243, 0.220575, 0.469091, 0.829132, 1.328885, 2.008961}},
      {0.49, 10, 12, {0.061127, 0.186972, 0.369514, 0.608374, 0.904929, 1.262808}},
  };
  return curves;
}

/// The setup of a solved curve, by Fung's or the neo-Hookean law, for a sphere.
inline IndentationSetup setup_of(const SolvedCurve& solved, double radius_mm) {
  const bool thick = solved.thicknesses_in_radii > 10;
  return {radius_mm, thick ? 0 : solved.thicknesses_in_radii * radius_mm,
          thick ? SpecimenBase::kThick : SpecimenBase::kBonded};
}

/// A solved curve for a sphere and a Young's modulus, at 40 depths by interpolation of force over depth^1.5.
inline IndentationCurve curve_of(const SolvedCurve& solved, double radius_mm, double youngs_modulus_kPa) {
  IndentationCurve curve;
  curve.setup = setup_of(solved, radius_mm);
  const auto relative = [&](std::size_t n) {
    return solved.force[n] / std::pow(0.1 * static_cast<double>(n + 1), 1.5);
  };
  constexpr int kSamples = 40;
  for (int n = 1; n <= kSamples; ++n) {
    const double depth = 0.1 * static_cast<double>(solved.force.size()) * n / kSamples;
    const double depth_index = std::max(0.0, depth / 0.1 - 1);
    const auto low = std::min(static_cast<std::size_t>(depth_index), solved.force.size() - 2);
    const double part = depth_index - static_cast<double>(low);
    // below the first depth the ratio tends to that of Hertz
    const double first = 4.0 / 3 / (1 - solved.poissons_ratio * solved.poissons_ratio);
    const double over = depth < 0.1 ? first + (relative(0) - first) * depth / 0.1
                                    : relative(low) * (1 - part) + relative(low + 1) * part;
    curve.depth_mm.push_back(depth * radius_mm);
    curve.force_N.push_back(1e-3 * youngs_modulus_kPa * radius_mm * radius_mm * over * std::pow(depth, 1.5));
  }
  return curve;
}

/// Curve of the model itself, pressed at 1 mm/s and then held, with noise.
struct Planted {
  ElasticConstants constants;
  TissueLaw law = TissueLaw::kExponential;
  IndentationSetup setup{4, 0, SpecimenBase::kThick};
  Relaxation relaxation = {};
  double to_mm = 2.4, hold_s = 0, noise = 0.02;
};
inline IndentationCurve planted_curve(const Planted& planted, std::mt19937& random) {
  std::normal_distribution<double> normal(0, planted.noise);
  IndentationCurve curve;
  curve.setup = planted.setup;
  constexpr int kSamples = 150;
  for (int n = 0; n < kSamples; ++n) {
    curve.time_s.push_back(planted.to_mm * n / (kSamples - 1));
    curve.depth_mm.push_back(planted.to_mm * n / (kSamples - 1));
  }
  for (int n = 1; n <= kSamples && planted.hold_s > 0; ++n) {
    curve.time_s.push_back(planted.to_mm + planted.hold_s * n / kSamples);
    curve.depth_mm.push_back(planted.to_mm);
  }
  // convolution of the relaxation function with the elastic force, by its definition
  std::vector<double> elastic_N;
  for (const double mm : curve.depth_mm)
    elastic_N.push_back(indentation_force_N(planted.constants, planted.law, planted.setup, mm));
  for (std::size_t n = 0; n < elastic_N.size(); ++n) {
    double force_N = 0;
    for (std::size_t m = 1; m <= n; ++m) {
      double left = 1;
      for (const RelaxationTerm& term : planted.relaxation.term) {
        if (!(term.fraction > 0)) continue;
        // mean of the relaxation over the step in which the load came
        const double late = curve.time_s[n] - curve.time_s[m - 1], early = curve.time_s[n] - curve.time_s[m];
        left -= term.fraction * (1 - term.time_s / (late - early) *
                                         (std::exp(-early / term.time_s) - std::exp(-late / term.time_s)));
      }
      force_N += left * (elastic_N[m] - elastic_N[m - 1]);
    }
    curve.force_N.push_back(force_N * (1 + normal(random)));
  }
  return curve;
}

}  // namespace palpate::testing
