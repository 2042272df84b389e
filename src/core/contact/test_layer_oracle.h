#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <vector>

/// Exact frictionless contact of a rigid sphere with a linear elastic layer bonded to a rigid base: slow, for
/// tests. Independent of palpate/contact/bonded_layer.h.
namespace palpate::testing {

/// Nodes and weights of the Gauss-Legendre rule on 0 ... end, by Newton's method on the polynomial.
struct LegendreRule {
  Eigen::VectorXd node, weight;
  LegendreRule(int count, double end) : node(count), weight(count) {
    for (int i = 0; i < count; ++i) {
      double x = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5)), slope = 0;
      for (int step = 0; step < 50; ++step) {
        double now = 1, before = 0;
        for (int n = 0; n < count; ++n) {
          const double next = ((2 * n + 1) * x * now - n * before) / (n + 1);
          before = now;
          now = next;
        }
        slope = count * (x * now - before) / (x * x - 1);
        x -= now / slope;
      }
      node[i] = 0.5 * end * (1 + x);
      weight[i] = end / ((1 - x * x) * slope * slope);
    }
  }
};

/// Layer of thickness 1 and contact modulus E* = 1.
class LayerOracle {
 public:
  explicit LayerOracle(double poissons_ratio) : kappa_(3 - 4 * poissons_ratio), rule_(120, 16) {}

  /// Ratio of the layer's surface displacement to that of a half-space under a pressure of wave number w /
  /// thickness.
  double response(double w) const {
    const double e = std::exp(-2 * w);
    return (kappa_ * (1 - e * e) - 4 * w * e) /
           (kappa_ * (1 + e * e) + (1 + kappa_ * kappa_ + 4 * w * w) * e);
  }
  /// c of B = -c / (t E*): the integral of 1 - response over w, over pi.
  double base() const {
    double sum = 0;
    for (int n = 0; n < rule_.node.size(); ++n) sum += rule_.weight[n] * (1 - response(rule_.node[n]));
    return sum / std::numbers::pi;
  }
  /// Compliance under the pressure sqrt(1 - r^2 / rho^2), in that of a half-space.
  double patch(double rho) const {
    static const LegendreRule rule(300, 60);
    double layer = 0, half_space = 0;
    for (int n = 0; n < rule.node.size(); ++n) {
      const double z = rule.node[n];
      const double pressure = 3 * (std::sin(z) - z * std::cos(z)) / (z * z * z);
      const double weight = rule.weight[n] * pressure * pressure;
      half_space += weight;
      layer += weight * response(z / rho);
    }
    return layer / half_space;
  }

  struct Contact {
    double radius, depth, force;
  };
  /// Contact of radius a < R by a sphere of radius R. With the pressure's transform written as the cosine
  /// transform of h on 0 ... a, the contact condition is Fredholm's equation
  ///
  ///     h(x) - integral of K(x, y) h(y) dy = d - x atanh(x / R),
  ///     K(x, y) = 2 / pi integral of (1 - response(w)) cos(w x) cos(w y) dw,
  ///
  /// the force 2 times the integral of h, and h(a) = 0 at the edge of a contact without adhesion.
  Contact contact(double sphere, double a) const {
    constexpr int kNodes = 20;
    static const LegendreRule unit(kNodes, 1);
    const Eigen::VectorXd node = a * unit.node, rule_weight = a * unit.weight;
    Eigen::VectorXd at(kNodes + 1);
    at << node, a;
    const Eigen::MatrixXd cosine = (at * rule_.node.transpose()).array().cos();
    Eigen::VectorXd weight(rule_.node.size());
    for (int n = 0; n < weight.size(); ++n)
      weight[n] = 2 / std::numbers::pi * rule_.weight[n] * (1 - response(rule_.node[n]));
    const Eigen::MatrixXd k = cosine * weight.asDiagonal() * cosine.topRows(kNodes).transpose();
    const Eigen::MatrixXd k_weighted = k * rule_weight.asDiagonal();
    const Eigen::VectorXd profile = at.array() * (at.array() / sphere).atanh();
    Eigen::MatrixXd right(kNodes, 2);
    right << Eigen::VectorXd::Ones(kNodes), profile.head(kNodes);
    const Eigen::MatrixXd h =
        (Eigen::MatrixXd::Identity(kNodes, kNodes) - k_weighted.topRows(kNodes)).partialPivLu().solve(right);
    const Eigen::RowVectorXd edge = k_weighted.row(kNodes);
    const double depth = (profile[kNodes] + edge.dot(h.col(1))) / (1 + edge.dot(h.col(0)));
    return {a, depth, 2 * rule_weight.dot(depth * h.col(0) - h.col(1))};
  }
  /// Contact at a depth, by bisection for its radius.
  Contact at_depth(double sphere, double depth) const {
    double low = 0, high = sphere * (1 - 1e-9);
    for (int n = 0; n < 24; ++n) {
      const double midpoint = 0.5 * (low + high);
      (contact(sphere, midpoint).depth < depth ? low : high) = midpoint;
    }
    return contact(sphere, 0.5 * (low + high));
  }

 private:
  double kappa_;
  LegendreRule rule_;
};

}  // namespace palpate::testing
