#include "palpate/tissue/elastic_contact.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "palpate/base/cube_root.h"
#include "palpate/contact/elastic_constants.h"

namespace palpate {
namespace {

/// Number of sample points of a patch, with equal shares of the force.
constexpr int kPatchPoints = 128;
/// Maximum number of iterations for the radius of a wide contact.
constexpr int kMaxRadii = 6;

// sample point of a patch: the cell from which its displacement is interpolated, and its position in that
// cell
struct CellSample {
  std::array<int, 3> cell;
  Eigen::Vector3d position;  ///< In cells from the box's corner
  Eigen::Vector3d fraction;
  bool inside[3];  ///< False where the point was clamped to the cell's boundary
};

bool find_cell(const ElasticGrid& grid, const Eigen::Vector3d& position, const Eigen::Vector3d& down,
               double reach, CellSample& found) {
  constexpr double kStep = 0.25;
  for (double distance = 1e-3; distance <= reach; distance += kStep) {
    const Eigen::Vector3d below = position + distance * down;
    for (int a = 0; a < 3; ++a) found.cell[a] = static_cast<int>(std::floor(below[a]));
    const auto [i, j, k] = found.cell;
    if (!grid.layout().contains_cell(i, j, k) || grid.mu()[grid.layout().cell(i, j, k)] == 0) continue;
    found.position = position;
    for (int a = 0; a < 3; ++a) {
      const double fraction = position[a] - found.cell[a];
      found.fraction[a] = std::clamp(fraction, 0.0, 1.0);
      found.inside[a] = fraction == found.fraction[a];
    }
    return true;
  }
  return false;
}

template <class Weights>
void merge_duplicates(Weights& weights) {
  std::sort(weights.begin(), weights.end(), [](const auto& a, const auto& b) { return a.value < b.value; });
  std::size_t count = 0;
  for (const auto& one : weights) {
    if (count > 0 && weights[count - 1].value == one.value)
      weights[count - 1].weight += one.weight;
    else
      weights[count++] = one;
  }
  weights.resize(count);
}

template <class Weights>
double product(const Weights& weights, const ElasticField& field) {
  double sum = 0;
  for (const auto& [value, weight] : weights) sum += static_cast<double>(weight) * field.values[value];
  return sum;
}

// depth at a force, and its derivative
struct DepthAt {
  double depth_mm, per_N;
};

DepthAt depth_of(double force_N, double compliance, double rho_mm, double radius_mm, double modulus) {
  const double a = std::cbrt(3 * force_N * radius_mm / (4 * modulus));
  // 0.75 F / (a E*) grows with F^(2/3)
  const double grid = compliance - 0.6 / (rho_mm * modulus), own = 0.75 / (a * modulus);
  return {force_N * (grid + own), grid + own * 2 / 3};
}

// force at a depth, by Newton's method
double force_at(double depth_mm, double compliance, double rho_mm, double radius_mm, double modulus) {
  // initial guess: Hertz contact, a lower bound, as if the grid contributed nothing
  double force = 4.0 / 3 * modulus * std::sqrt(radius_mm) * std::pow(depth_mm, 1.5);
  for (int n = 0; n < 50; ++n) {
    const DepthAt at = depth_of(force, compliance, rho_mm, radius_mm, modulus);
    const double step = (depth_mm - at.depth_mm) / at.per_N;
    const double next = std::clamp(force + step, force / 4, force * 4);
    if (std::abs(next - force) <= 1e-9 * force) return next;
    force = next;
  }
  return force;
}

}  // namespace

PressurePatch::PressurePatch(const ElasticGrid& grid, const Point<Patient>& at,
                             const Vector<Patient>& outward, double rho_mm)
    : outward_(grid.box().axes.transpose() * outward.eigen()), axes_(grid.box().axes) {
  const double h = grid.box().cell_mm;
  const Eigen::Vector3d across = outward_.unitOrthogonal(), other = outward_.cross(across);
  const Eigen::Vector3d centre = grid.box().local_mm(at) / h;
  std::array<Eigen::Vector3d, kPatchPoints> points;
  // rotation by the golden angle, pi (3 - sqrt 5); constants, because library sines differ between machines
  constexpr double kCos = -0.73736887807831985, kSin = 0.67549029426152364;
  double c = 1, s = 0;
  for (int n = 0; n < kPatchPoints; ++n) {
    // the force share within r is 1 - (1 - r2 / rho2)^(3/2)
    const double beyond = cube_root(1 - (n + 0.5) / kPatchPoints);
    const double r = rho_mm / h * std::sqrt(1 - beyond * beyond);
    points[static_cast<std::size_t>(n)] = centre + r * (c * across + s * other);
    const double next = c * kCos - s * kSin;
    s = c * kSin + s * kCos;
    c = next;
  }
  spread(grid, points);
}

PressurePatch::PressurePatch(const ElasticGrid& grid, std::span<const Point<Patient>> positions,
                             const Vector<Patient>& outward)
    : outward_(grid.box().axes.transpose() * outward.eigen()), axes_(grid.box().axes) {
  std::vector<Eigen::Vector3d> in_cells;
  for (const Point<Patient>& position : positions)
    in_cells.push_back(grid.box().local_mm(position) / grid.box().cell_mm);
  spread(grid, in_cells);
}

void PressurePatch::spread(const ElasticGrid& grid, std::span<const Eigen::Vector3d> positions) {
  const double h = grid.box().cell_mm;
  std::vector<CellSample> samples;
  double modulus = 0, poissons_ratio = 0;
  for (const Eigen::Vector3d& at : positions) {
    CellSample sample;
    if (!find_cell(grid, at, -outward_, kMaxDepth_cells, sample)) continue;
    samples.push_back(sample);
    const std::size_t cell = grid.layout().cell(sample.cell[0], sample.cell[1], sample.cell[2]);
    const double mu = grid.mu()[cell] / grid.fill()[cell], lambda = grid.lambda()[cell] / grid.fill()[cell];
    modulus += 4 * mu * (lambda + mu) / (lambda + 2 * mu);
    poissons_ratio += 0.5 * lambda / (lambda + mu);
  }
  if (samples.empty()) return;
  modulus_ = modulus / static_cast<double>(samples.size());
  poissons_ratio_ = std::clamp(poissons_ratio / static_cast<double>(samples.size()), 0.0, kMaxPoissonsRatio);

  const double sample_weight = 1.0 / static_cast<double>(samples.size());
  int along = 0;
  outward_.cwiseAbs().maxCoeff(&along);
  const auto& all = grid.layout().cells;
  for (const CellSample& sample : samples) {
    for (int corner = 0; corner < 8; ++corner) {
      double factor[3], slope[3];
      std::array<int, 3> node;
      for (int a = 0; a < 3; ++a) {
        const bool high = (corner >> a & 1) != 0;
        node[a] = sample.cell[a] + (high ? 1 : 0);
        factor[a] = high ? sample.fraction[a] : 1 - sample.fraction[a];
        slope[a] = sample.inside[a] ? (high ? 1 : -1) / h : 0;
      }
      if (grid.constraint(node[0], node[1], node[2]) == 0) {
        const int one = (along + 1) % 3, other = (along + 2) % 3;
        node_loads_.push_back({static_cast<std::uint32_t>(node[other] * (all[one] + 1) + node[one]),
                               static_cast<std::uint32_t>(grid.layout().node(node[0], node[1], node[2], 0)),
                               static_cast<float>(sample_weight * factor[0] * factor[1] * factor[2])});
      }
      for (int c = 0; c < 3; ++c) {
        const auto value = static_cast<std::uint32_t>(grid.layout().node(node[0], node[1], node[2], c));
        const double into = -outward_[c] * sample_weight;
        weights_.push_back({value, static_cast<float>(into * factor[0] * factor[1] * factor[2])});
        for (int a = 0; a < 3; ++a)
          along_[a].push_back(
              {value, static_cast<float>(into * slope[a] * factor[(a + 1) % 3] * factor[(a + 2) % 3])});
      }
    }
  }
  row_ = static_cast<std::uint32_t>(grid.layout().row);
  merge_duplicates(weights_);
  merge_duplicates(node_loads_);
  std::sort(node_loads_.begin(), node_loads_.end(), [](const NodeLoad& a, const NodeLoad& b) {
    return std::pair(a.column, a.value) < std::pair(b.column, b.value);
  });
  for (auto& weights : along_) merge_duplicates(weights);
}

void PressurePatch::add(double force_N, ElasticField& nodes_N) const {
  for (const auto& [value, weight] : weights_) nodes_N.values[value] += static_cast<float>(force_N * weight);
}

double PressurePatch::displacement_mm(const ElasticField& u_mm) const {
  return product(weights_, u_mm);
}

ConstrainedMeans PressurePatch::columns(double min_load_fraction) const {
  // end of the column that begins at an index
  const auto end_of = [&](std::size_t first) {
    std::size_t end = first;
    while (end < node_loads_.size() && node_loads_[end].column == node_loads_[first].column) ++end;
    return end;
  };
  const auto column_load = [&](std::size_t first) {
    double sum = 0;
    for (std::size_t n = first, end = end_of(first); n < end; ++n) sum += node_loads_[n].weight;
    return sum;
  };
  double largest = 0;
  for (std::size_t n = 0; n < node_loads_.size(); n = end_of(n)) largest = std::max(largest, column_load(n));
  ConstrainedMeans means;
  std::vector<Weight> mean;
  for (std::size_t n = 0; n < node_loads_.size(); n = end_of(n)) {
    if (!(column_load(n) > 0) || column_load(n) < min_load_fraction * largest) continue;
    for (std::uint32_t c = 0; c < 3; ++c) {
      mean.clear();
      for (std::size_t m = n, end = end_of(n); m < end; ++m)
        mean.push_back({node_loads_[m].value + c * row_, node_loads_[m].weight});
      means.add(mean);
    }
  }
  return means;
}

Vector<Patient> PressurePatch::gradient_along_surface(const ElasticField& u_mm) const {
  const Eigen::Vector3d slope(product(along_[0], u_mm), product(along_[1], u_mm), product(along_[2], u_mm));
  return Vector<Patient>(axes_ * (slope - slope.dot(outward_) * outward_));
}

SphereContact press_sphere(const ElasticGrid& grid, ElasticSolver& solver, const Point<Patient>& at,
                           const Vector<Patient>& outward, double radius_mm, double depth_mm,
                           ElasticField& unit_mm, ElasticField& load_N, int max_iterations,
                           double tolerance) {
  SphereContact contact;
  if (!(depth_mm > 0)) return contact;
  const double min_mm = 3 * grid.box().cell_mm;
  double rho_mm = min_mm;
  for (int n = 0; n < kMaxRadii; ++n) {
    const PressurePatch patch(grid, at, outward, rho_mm);
    if (!patch.touches()) return contact;
    std::fill(load_N.values.begin(), load_N.values.end(), 0.0f);
    patch.add(1, load_N);
    contact.solution = solver.solve(load_N, unit_mm, max_iterations, tolerance);
    const double w = patch.displacement_mm(unit_mm), modulus = patch.contact_modulus_N_per_mm2();
    const double force = force_at(depth_mm, w, rho_mm, radius_mm, modulus);
    contact.force_N = force;
    contact.compliance_mm_per_N = w;
    contact.contact_radius_mm = std::cbrt(3 * force * radius_mm / (4 * modulus));
    // W(rho) - 0.6 / (rho E*) depends only weakly on rho, so few iterations suffice
    contact.tangential_N = patch.gradient_along_surface(unit_mm) * (force * force);
    const double next_mm = std::max(contact.contact_radius_mm, min_mm);
    if (std::abs(next_mm - rho_mm) <= 1e-3 * rho_mm) break;
    rho_mm = next_mm;
  }
  return contact;
}

Eigen::MatrixXd contact_compliance_mm_per_N(ElasticSolver& solver, std::span<const PressurePatch> patches,
                                            double tolerance, double* worst_residual) {
  constexpr int kMaxIterations = 200;
  const auto count = static_cast<Eigen::Index>(patches.size());
  Eigen::MatrixXd w(count, count);
  ElasticField load(solver.layout()), u(solver.layout());
  double worst = 0;
  for (Eigen::Index m = 0; m < count; ++m) {
    std::fill(load.values.begin(), load.values.end(), 0.0f);
    std::fill(u.values.begin(), u.values.end(), 0.0f);
    patches[static_cast<std::size_t>(m)].add(1, load);
    worst = std::max(worst, solver.solve(load, u, kMaxIterations, tolerance).residual);
    for (Eigen::Index n = 0; n < count; ++n)
      w(n, m) = patches[static_cast<std::size_t>(n)].displacement_mm(u);
  }
  if (worst_residual != nullptr) *worst_residual = worst;
  return w;
}

Eigen::VectorXd contact_forces(const Eigen::MatrixXd& compliance, const Eigen::VectorXd& depth_mm) {
  // Active set that changes by one patch at a time (Lawson and Hanson 1974, for least squares). Terminates,
  // because the energy decreases with every set.
  const Eigen::Index count = depth_mm.size();
  Eigen::VectorXd force = Eigen::VectorXd::Zero(count);
  std::vector<bool> pressed(static_cast<std::size_t>(count), false);
  const double smallest = 1e-9 * depth_mm.cwiseAbs().maxCoeff();
  for (Eigen::Index turn = 0; turn < 10 * count; ++turn) {
    const Eigen::VectorXd within = depth_mm - compliance * force;
    Eigen::Index deepest = -1;
    for (Eigen::Index n = 0; n < count; ++n)
      if (!pressed[static_cast<std::size_t>(n)] && within[n] > smallest &&
          (deepest < 0 || within[n] > within[deepest]))
        deepest = n;
    if (deepest < 0) break;
    pressed[static_cast<std::size_t>(deepest)] = true;
    for (Eigen::Index inner = 0; inner <= count; ++inner) {
      std::vector<Eigen::Index> set;
      for (Eigen::Index n = 0; n < count; ++n)
        if (pressed[static_cast<std::size_t>(n)]) set.push_back(n);
      if (set.empty()) break;
      const Eigen::MatrixXd part = compliance(set, set);
      const Eigen::VectorXd solution = part.ldlt().solve(Eigen::VectorXd(depth_mm(set)));
      // largest step for which no patch pulls
      double step = 1;
      for (std::size_t n = 0; n < set.size(); ++n)
        if (solution[static_cast<Eigen::Index>(n)] <= 0)
          step = std::min(step, force[set[n]] / (force[set[n]] - solution[static_cast<Eigen::Index>(n)]));
      for (std::size_t n = 0; n < set.size(); ++n) {
        double& f = force[set[n]];
        f += step * (solution[static_cast<Eigen::Index>(n)] - f);
        if (step < 1 && f <= 1e-12 * force.maxCoeff()) {
          f = 0;
          pressed[static_cast<std::size_t>(set[n])] = false;
        }
      }
      if (step >= 1) break;
    }
  }
  return force;
}

}  // namespace palpate
