#include "verification/tissue_cases.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/elastic_solver.h"
#include "verification/accuracy_random.h"
#include "verification/tissue_frame.h"

namespace palpate {
namespace {

constexpr double kN_per_mm2_of_kPa = 1e-3;
constexpr int kMaxTissueIterations = 300;
constexpr double kTissueTolerance = 1e-5;

ElasticMaterial deformable(double kPa, double poissons_ratio) {
  return {Matter::kSoft, kPa, poissons_ratio};
}

ElasticBox box_of(std::array<int, 3> cells, double cell_mm = 1) {
  ElasticBox box;
  box.cells = cells;
  box.cell_mm = cell_mm;
  return box;
}

template <class Visit>
void for_each_node_of(const ElasticLayout& layout, const Visit& visit) {
  for (int k = 0; k <= layout.cells[2]; ++k)
    for (int j = 0; j <= layout.cells[1]; ++j)
      for (int i = 0; i <= layout.cells[0]; ++i) visit(i, j, k);
}

void set_node(const ElasticLayout& layout, int i, int j, int k, const Eigen::Vector3d& value,
              ElasticField& field) {
  for (int c = 0; c < 3; ++c) field.values[layout.node(i, j, k, c)] = static_cast<float>(value[c]);
}

Eigen::Vector3d node_of(const ElasticLayout& layout, int i, int j, int k, const ElasticField& field) {
  return {field.values[layout.node(i, j, k, 0)], field.values[layout.node(i, j, k, 1)],
          field.values[layout.node(i, j, k, 2)]};
}

/// Result of solve_inside(): maximum error of an interior node, and the largest displacement.
struct InteriorError {
  double maximum = 0, largest_displacement = 0;
  int iterations = 0;
};
/// Solves a block whose surface is displaced by `prescribed(x)`, and compares its interior with the same
/// function.
template <class Prescribed>
InteriorError solve_inside(const ElasticMaterial& material, int cells, const Prescribed& prescribed) {
  ElasticGrid grid(
      box_of({cells, cells, cells}), [&](const Point<Patient>&) { return material; }, 1);
  const ElasticLayout& layout = grid.layout();
  ElasticField u(layout), load(layout);
  for_each_node_of(layout, [&](int i, int j, int k) {
    if (std::min({i, j, k}) > 0 && std::max({i, j, k}) < cells) return;
    grid.constrain(i, j, k, ElasticGrid::kFixed);
    set_node(layout, i, j, k, prescribed(Eigen::Vector3d(i, j, k)), u);
  });
  ElasticSolver solver(grid);
  InteriorError result;
  result.iterations = solver.solve(load, u, kMaxTissueIterations, 2e-7).iterations;
  for_each_node_of(layout, [&](int i, int j, int k) {
    const Eigen::Vector3d expected = prescribed(Eigen::Vector3d(i, j, k));
    result.maximum = std::max(result.maximum, (node_of(layout, i, j, k, u) - expected).norm());
    result.largest_displacement = std::max(result.largest_displacement, expected.norm());
  });
  return result;
}

}  // namespace

TissueDeviation patch_case(int cells, double poissons_ratio) {
  AccuracyRandom random(18);
  Eigen::Matrix3d slope;
  for (double& one : slope.reshaped()) one = random.between(-0.1, 0.1);
  const InteriorError interior =
      solve_inside(deformable(10, poissons_ratio), cells,
                   [&](const Eigen::Vector3d& x) { return Eigen::Vector3d(slope * x); });
  return {100 * interior.maximum / interior.largest_displacement, interior.iterations};
}

TissueDeviation turned_case(int cells) {
  ElasticGrid grid(
      box_of({cells, cells, cells}), [](const Point<Patient>&) { return deformable(10, 0.45); }, 1);
  const ElasticLayout& layout = grid.layout();
  ElasticSolver solver(grid);
  const Eigen::Vector3d centre = Eigen::Vector3d::Constant(cells / 2.0);
  // a rotation for sign 1; for sign -1 the shear with the same slopes except for their signs
  const auto forces = [&](double sign) {
    ElasticField u(layout), force(layout);
    for_each_node_of(layout, [&](int i, int j, int k) {
      const Eigen::Vector3d x = Eigen::Vector3d(i, j, k) - centre;
      set_node(layout, i, j, k, 0.01 * Eigen::Vector3d(x.y() + x.z(), -sign * x.x(), -sign * x.x()), u);
    });
    solver.forces(u, force);
    double largest = 0;
    for (const float f : force.values) largest = std::max<double>(largest, std::abs(f));
    return largest;
  };
  return {100 * forces(1) / forces(-1), 0};
}

TissueDeviation cantilever_case(int cells_high) {
  constexpr double kPa = 100, kNu = 0.3, kLoad_N = 1e-3;
  const int high = cells_high, length = 6 * cells_high;
  ElasticGrid grid(
      box_of({length, high, high}), [](const Point<Patient>&) { return deformable(kPa, kNu); }, 1);
  const ElasticLayout& layout = grid.layout();
  ElasticField load(layout), u(layout);
  for (int k = 0; k <= high; ++k)
    for (int j = 0; j <= high; ++j) {
      grid.constrain(0, j, k, ElasticGrid::kFixed);
      // the node's share of the area of the end face
      const double part = (j % high == 0 ? 0.5 : 1) * (k % high == 0 ? 0.5 : 1) / (high * high);
      load.values[layout.node(length, j, k, 2)] = static_cast<float>(kLoad_N * part);
    }
  ElasticSolver solver(grid);
  TissueDeviation result;
  result.iterations = solver.solve(load, u, kMaxTissueIterations, kTissueTolerance).iterations;
  const double deflection_mm = node_of(layout, length, high / 2, high / 2, u).z();
  const double e = kPa * kN_per_mm2_of_kPa, g = e / (2 * (1 + kNu)), area = high * high,
               inertia = area * area / 12;
  const double shear = 10 * (1 + kNu) / (12 + 11 * kNu);
  const double expected =
      kLoad_N * std::pow(length, 3) / (3 * e * inertia) + kLoad_N * length / (shear * g * area);
  result.error_percent = 100 * (deflection_mm / expected - 1);
  return result;
}

TissueDeviation cook_case(int cells_long) {
  // E 1 and F 1 per thickness, in kPa and mN; 48 long, 44 high at the root, 16 at the tip
  const double h = 48.0 / cells_long;
  ElasticGrid grid(
      box_of({cells_long, static_cast<int>(std::ceil(60 / h)), 1}, h),
      [](const Point<Patient>& p) {
        const bool in = p.y() > 44 * p.x() / 48 && p.y() < 44 + 16 * p.x() / 48;
        return in ? deformable(1, 1.0 / 3) : ElasticMaterial{};
      },
      8);
  const ElasticLayout& layout = grid.layout();
  ElasticField load(layout), u(layout);
  for (int j = 0; j <= layout.cells[1]; ++j)
    for (int k = 0; k <= 1; ++k) grid.constrain(0, j, k, ElasticGrid::kFixedX | ElasticGrid::kFixedY);
  for (int j = 0; j <= layout.cells[1]; ++j) grid.constrain(0, j, 0, ElasticGrid::kFixedZ);
  // edge of the tip: each node gets the part of the edge nearest to it
  const int steps = 16;
  for (int j = 0; j < layout.cells[1]; ++j)
    for (int s = 0; s < steps; ++s) {
      const double at = j + (s + 0.5) / steps;
      if (at * h < 44 || at * h > 60) continue;
      const double part = h / steps / 16 * h * 1e-3 / 2;
      for (int k = 0; k <= 1; ++k) {
        load.values[layout.node(cells_long, j, k, 1)] += static_cast<float>(part * (1 - (at - j)));
        load.values[layout.node(cells_long, j + 1, k, 1)] += static_cast<float>(part * (at - j));
      }
    }
  ElasticSolver solver(grid);
  TissueDeviation result;
  result.iterations = solver.solve(load, u, kMaxTissueIterations, kTissueTolerance).iterations;
  const double rise = node_of(layout, cells_long, static_cast<int>(std::lround(52 / h)), 0, u).y();
  result.error_percent = 100 * (rise / 23.96 - 1);
  return result;
}

TissueDeviation series_case(double seam_in_cell) {
  constexpr int kCells = 8;
  const double seam = 3 + seam_in_cell, nu = 0.4;
  ElasticGrid grid(
      box_of({3, 3, kCells}), [&](const Point<Patient>& p) { return deformable(p.z() < seam ? 5 : 50, nu); },
      16);
  const ElasticLayout& layout = grid.layout();
  ElasticField load(layout), u(layout), force(layout);
  constexpr double kPressed_mm = 0.1;
  for_each_node_of(layout, [&](int i, int j, int k) {
    if (i % 3 == 0) grid.constrain(i, j, k, ElasticGrid::kFixedX);
    if (j % 3 == 0) grid.constrain(i, j, k, ElasticGrid::kFixedY);
    if (k % kCells == 0) grid.constrain(i, j, k, ElasticGrid::kFixedZ);
    if (k == kCells) u.values[layout.node(i, j, k, 2)] = static_cast<float>(-kPressed_mm);
  });
  ElasticSolver solver(grid);
  TissueDeviation result;
  result.iterations = solver.solve(load, u, kMaxTissueIterations, kTissueTolerance).iterations;
  solver.forces(u, force);
  double pressed_N = 0;
  for (int j = 0; j <= 3; ++j)
    for (int i = 0; i <= 3; ++i) pressed_N -= force.values[layout.node(i, j, kCells, 2)];
  const auto confined = [&](double kPa) {
    return kPa * kN_per_mm2_of_kPa * (1 - nu) / ((1 + nu) * (1 - 2 * nu));
  };
  const double expected = 9 * kPressed_mm / (seam / confined(5) + (kCells - seam) / confined(50));
  result.error_percent = 100 * (pressed_N / expected - 1);
  return result;
}

TissueDeviation boussinesq_case(int cells, double poissons_ratio) {
  constexpr double kPa = 10;
  ElasticGrid grid(
      box_of({cells, cells, cells / 2}),
      [&](const Point<Patient>&) { return deformable(kPa, poissons_ratio); }, 1);
  const ElasticLayout& layout = grid.layout();
  const int middle = cells / 2, top = cells / 2;
  grid.set_boundary_springs({true, true, true, true, true, false}, Point<Patient>(middle, middle, top));
  ElasticSolver solver(grid);
  ElasticField load(layout), u(layout);
  load.values[layout.node(middle, middle, top, 2)] = -1e-3f;
  TissueDeviation result;
  result.iterations = solver.solve(load, u, kMaxTissueIterations, kTissueTolerance).iterations;
  double sum = 0;
  int count = 0;
  for (int j = 0; j <= cells; ++j)
    for (int i = 0; i <= cells; ++i) {
      const double r = std::hypot(i - middle, j - middle);
      if (r < 4 || r > 10) continue;
      const double expected =
          1e-3 * (1 - poissons_ratio * poissons_ratio) / (std::numbers::pi * kPa * kN_per_mm2_of_kPa * r);
      sum += -u.values[layout.node(i, j, top, 2)] / expected - 1;
      ++count;
    }
  result.error_percent = 100 * sum / count;
  return result;
}

namespace {

// force of a sphere on a half-space, relative to Hertz's
struct PressedHalfSpace {
  double force_N, hertz_N;
  int iterations;
};
PressedHalfSpace press_half_space(const HalfSpacePress& press, const Vector<Patient>& lateral_cells) {
  constexpr double kPa = 10, kRadius_mm = 16;
  const double half = press.cells / 2.0;
  const Point<Patient> at = Point<Patient>(half, half, half) + press.offset_cells + lateral_cells;
  const Vector<Patient> outward = press.outward.normalized();
  ElasticGrid grid(
      box_of({press.cells, press.cells, press.cells}),
      [&](const Point<Patient>& p) {
        return (p - at).dot(outward) < 0 ? deformable(kPa, press.poissons_ratio) : ElasticMaterial{};
      },
      16);
  grid.set_boundary_springs({true, true, true, true, true, true}, at);
  ElasticSolver solver(grid);
  ElasticField unit(solver.layout()), load(solver.layout());
  const double depth = press.radius_cells * press.radius_cells / kRadius_mm;
  const SphereContact contact =
      press_sphere(grid, solver, at, outward, kRadius_mm, depth, unit, load, kMaxTissueIterations, 1e-4);
  const double modulus = kPa * kN_per_mm2_of_kPa / (1 - press.poissons_ratio * press.poissons_ratio);
  return {contact.force_N, 4.0 / 3 * modulus * std::sqrt(kRadius_mm) * std::pow(depth, 1.5),
          contact.solution.iterations};
}

}  // namespace

TissueDeviation hertz_case(const HalfSpacePress& press) {
  const PressedHalfSpace pressed = press_half_space(press, {});
  return {100 * (pressed.force_N / pressed.hertz_N - 1), pressed.iterations};
}

TissueDeviation ripple_case(const HalfSpacePress& press, int steps) {
  const Vector<Patient> outward = press.outward.normalized();
  const Vector<Patient> along(outward.eigen().cross(Eigen::Vector3d(0.3, 1, 0.2)).normalized());
  double min_N = 0, max_N = 0, sum_N = 0;
  for (int n = 0; n < steps; ++n) {
    const double force_N = press_half_space(press, along * (1.4 * n / steps)).force_N;
    min_N = n == 0 ? force_N : std::min(min_N, force_N);
    max_N = std::max(max_N, force_N);
    sum_N += force_N;
  }
  return {100 * (max_N - min_N) * steps / sum_N, 0};
}

namespace {

// nodes of a flat surface around a central one, grouped by their distance: by symmetry they carry equal
// forces
struct NodeRing {
  double r = 0;  ///< Distance from the central node, in cells
  std::vector<Point<Patient>> nodes;
};
std::vector<NodeRing> node_rings(int middle_x, int middle_y, double z, double within) {
  std::map<int, NodeRing> rings;
  const int reach = static_cast<int>(within);
  for (int j = -reach; j <= reach; ++j)
    for (int i = -reach; i <= reach; ++i) {
      const int squared = i * i + j * j;
      if (squared > within * within) continue;
      rings[squared].r = std::sqrt(squared);
      rings[squared].nodes.emplace_back(middle_x + i, middle_y + j, z);
    }
  std::vector<NodeRing> list;
  for (auto& [squared, ring] : rings) list.push_back(std::move(ring));
  return list;
}

Eigen::MatrixXd ring_compliance(const ElasticGrid& grid, const std::vector<NodeRing>& rings) {
  std::vector<PressurePatch> patches;
  for (const NodeRing& ring : rings) patches.emplace_back(grid, ring.nodes, Vector<Patient>(0, 0, 1));
  ElasticSolver solver(grid);
  return contact_compliance_mm_per_N(solver, patches, 1e-4);
}

}  // namespace

TissueDeviation punch_case(int cells, int radius_cells) {
  constexpr double kPa = 10, kNu = 0.45, kDepth_mm = 0.1;
  const int middle = cells / 2, top = cells / 2;
  ElasticGrid grid(
      box_of({cells, cells, top}), [](const Point<Patient>&) { return deformable(kPa, kNu); }, 1);
  grid.set_boundary_springs({true, true, true, true, true, false}, Point<Patient>(middle, middle, top));
  const auto rings = node_rings(middle, middle, top, radius_cells);
  const Eigen::MatrixXd w = ring_compliance(grid, rings);
  const Eigen::VectorXd force =
      contact_forces(w, Eigen::VectorXd::Constant(static_cast<Eigen::Index>(rings.size()), kDepth_mm));
  std::size_t nodes = 0;
  for (const NodeRing& ring : rings) nodes += ring.nodes.size();
  // effective radius: each node represents the area nearest to it
  const double a = std::sqrt(static_cast<double>(nodes) / std::numbers::pi);
  const double expected = 2 * a * kPa * kN_per_mm2_of_kPa * kDepth_mm / (1 - kNu * kNu);
  return {100 * (force.sum() / expected - 1), 0};
}

TissueDeviation layer_case(int cells_thick, double nu, double depth_ratio) {
  constexpr double kPa = 10;
  const int thick = cells_thick, wide = 6 * thick, middle = wide / 2;
  ElasticGrid grid(
      box_of({wide, wide, thick}), [&](const Point<Patient>&) { return deformable(kPa, nu); }, 1);
  for (int j = 0; j <= wide; ++j)
    for (int i = 0; i <= wide; ++i) grid.constrain(i, j, 0, ElasticGrid::kFixed);
  // far away, where the deformation is negligible, the layer simply ends
  const double radius = 3 * thick, root = depth_ratio * thick, depth = root * root / radius;
  const auto rings = node_rings(middle, middle, thick, 1.5 * root);
  const Eigen::MatrixXd w = ring_compliance(grid, rings);
  Eigen::VectorXd deep(static_cast<Eigen::Index>(rings.size()));
  for (std::size_t n = 0; n < rings.size(); ++n)
    deep[static_cast<Eigen::Index>(n)] = depth - rings[n].r * rings[n].r / (2 * radius);
  const double force = contact_forces(w, deep).sum();

  constexpr double kPi = std::numbers::pi;
  const double alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1 - nu);
  const double beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1 - nu);
  const double x = depth_ratio, cubed = alpha * alpha * alpha;
  const double series = 1 - 2 * alpha / kPi * x + 4 * alpha * alpha / (kPi * kPi) * x * x -
                        8 / std::pow(kPi, 3) * (cubed + 4 * kPi * kPi / 15 * beta) * std::pow(x, 3) +
                        16 * alpha / std::pow(kPi, 4) * (cubed + 3 * kPi * kPi / 5 * beta) * std::pow(x, 4);
  const double expected =
      4.0 / 3 * kPa * kN_per_mm2_of_kPa / (1 - nu * nu) * std::sqrt(radius) * std::pow(depth, 1.5) * series;
  return {100 * (force / expected - 1), 0};
}

TissueDeviation stretched_case(double height_ratio) {
  constexpr int kCells = 4;
  constexpr double kPa = 10, kNu = 0.45;
  ElasticGrid grid(
      box_of({kCells, kCells, kCells}), [](const Point<Patient>&) { return deformable(kPa, kNu); }, 1);
  const ElasticLayout& layout = grid.layout();
  ElasticField load(layout), u(layout), force(layout);
  for_each_node_of(layout, [&](int i, int j, int k) {
    if (i == 0) grid.constrain(i, j, k, ElasticGrid::kFixedX);
    if (j == 0) grid.constrain(i, j, k, ElasticGrid::kFixedY);
    if (k % kCells == 0) grid.constrain(i, j, k, ElasticGrid::kFixedZ);
    u.values[layout.node(i, j, k, 2)] = static_cast<float>((height_ratio - 1) * k);
  });
  ElasticSolver solver(grid);
  NeoHookeanSettings settings;
  settings.max_steps = 50;
  settings.tolerance = 1e-6;
  TissueDeviation result;
  result.iterations = solver.solve_neo_hookean(load, u, settings).iterations;
  solver.neo_hookean_forces(u, force);
  double pulled_N = 0;
  for (int j = 0; j <= kCells; ++j)
    for (int i = 0; i <= kCells; ++i) pulled_N += force.values[layout.node(i, j, kCells, 2)];

  // lateral stretch q at the height ratio h: mu q + s h q = 0, s = (lambda + mu) (h q2 - 1) - mu; axial
  // stress: mu h + s q2
  const double mu = kPa * kN_per_mm2_of_kPa / (2 * (1 + kNu)), lambda = 2 * mu * kNu / (1 - 2 * kNu);
  const double s = -mu / height_ratio, squared = ((s + mu) / (lambda + mu) + 1) / height_ratio;
  const double expected = kCells * kCells * (mu * height_ratio + s * squared);
  result.error_percent = 100 * (pulled_N / expected - 1);
  return result;
}

FiniteLayer finite_layer(std::array<int, 3> cells, double depth_ratio) {
  constexpr double kPa = 10, kNu = 0.45, kFrame_mm = 1.0 / 3;
  const int middle_x = cells[0] / 2, middle_y = cells[1] / 2, thick = cells[2];
  const double depth = depth_ratio * thick, radius = thick;
  ElasticGrid grid(
      box_of(cells), [&](const Point<Patient>&) { return deformable(kPa, kNu); }, 1);
  const ElasticLayout& layout = grid.layout();
  for (int j = 0; j <= cells[1]; ++j)
    for (int i = 0; i <= cells[0]; ++i) grid.constrain(i, j, 0, ElasticGrid::kFixed);

  // the nodes in contact with the sphere, constrained to it from then on
  const auto rings = node_rings(middle_x, middle_y, thick, std::sqrt(2 * radius * depth));
  Eigen::VectorXd deep(static_cast<Eigen::Index>(rings.size()));
  for (std::size_t n = 0; n < rings.size(); ++n)
    deep[static_cast<Eigen::Index>(n)] = depth - rings[n].r * rings[n].r / (2 * radius);
  const Eigen::VectorXd pressed = contact_forces(ring_compliance(grid, rings), deep);
  ElasticField whole(layout), load(layout), u(layout), force(layout);
  std::vector<std::size_t> touched;
  for (std::size_t n = 0; n < rings.size(); ++n) {
    if (pressed[static_cast<Eigen::Index>(n)] == 0) continue;
    for (const Point<Patient>& node : rings[n].nodes) {
      const int i = static_cast<int>(node.x()), j = static_cast<int>(node.y());
      grid.constrain(i, j, thick, ElasticGrid::kFixedZ);
      touched.push_back(layout.node(i, j, thick, 2));
      whole.values[touched.back()] = static_cast<float>(-deep[static_cast<Eigen::Index>(n)]);
    }
  }
  const auto force_of = [&](const ElasticField& of) {
    double sum = 0;
    for (const std::size_t value : touched) sum -= of.values[value];
    return sum;
  };
  ElasticSolver solver(grid);
  solver.solve(load, whole, kMaxTissueIterations, kTissueTolerance);
  solver.forces(whole, force);
  const double linear_N = force_of(force);

  // in frames: all nodes follow the linear solution, then a Newton step
  FiniteLayer result;
  result.cells = grid.soft_cells();
  NeoHookeanSettings frame, exact;
  frame.max_iterations = 3;
  frame.tolerance = 0;
  exact.max_steps = 60;
  exact.max_iterations = 40;
  const int frames = std::max(1, static_cast<int>(std::lround(depth / kFrame_mm)));
  std::vector<double> seconds;
  for (int n = 0; n < frames; ++n) {
    for (std::size_t value = 0; value < u.values.size(); ++value)
      u.values[value] += whole.values[value] / static_cast<float>(frames);
    const double begin = tissue_thread_seconds();
    result.min_volume = std::min(result.min_volume, solver.solve_neo_hookean(load, u, frame).min_volume);
    seconds.push_back(tissue_thread_seconds() - begin);
    solver.neo_hookean_forces(u, force);
    const double in_frame_N = force_of(force);
    ElasticField converged = u;
    result.converged = result.converged && solver.solve_neo_hookean(load, converged, exact).converged;
    solver.neo_hookean_forces(converged, force);
    const double expected_N = force_of(force);
    if (n > 0)
      result.frame_error_percent =
          std::max(result.frame_error_percent, 100 * std::abs(in_frame_N / expected_N - 1));
    result.linear_error_percent = 100 * (linear_N * (n + 1) / frames / expected_N - 1);
  }
  std::nth_element(seconds.begin(), seconds.begin() + frames / 2, seconds.end());
  result.frame_ms = 1e3 * seconds[static_cast<std::size_t>(frames / 2)];
  return result;
}

double convergence_order(int cells) {
  constexpr double kNu = 0.3;
  const auto relative_error = [&](int n) {
    // a point force outside the block, a third of its edge away
    const Eigen::Vector3d source = Eigen::Vector3d(-0.33, 0.4, 0.6) * n, pull = Eigen::Vector3d(1, 0.5, -0.3);
    const InteriorError interior = solve_inside(deformable(10, kNu), n, [&](const Eigen::Vector3d& x) {
      const Eigen::Vector3d displacement = (x - source) / n;
      const double r = displacement.norm();
      return Eigen::Vector3d(((3 - 4 * kNu) * pull + displacement * displacement.dot(pull) / (r * r)) / r);
    });
    return interior.maximum / interior.largest_displacement;
  };
  return std::log2(relative_error(cells) / relative_error(2 * cells));
}

NoduleLoop nodule_loop(int cells, int steps) {
  constexpr double kPa = 10, kNu = 0.45, kRadius_mm = 6, kDepth_mm = 2;
  const int top = cells / 2;
  const Point<Patient> nodule(cells / 2.0, cells / 2.0, top - 5 - 4);
  ElasticGrid grid(
      box_of({cells, cells, top}),
      [&](const Point<Patient>& p) { return deformable((p - nodule).norm() < 4 ? 10 * kPa : kPa, kNu); }, 2);
  for (int j = 0; j <= cells; ++j)
    for (int i = 0; i <= cells; ++i) grid.constrain(i, j, 0, ElasticGrid::kFixed);
  ElasticSolver solver(grid);
  ElasticField unit(solver.layout()), load(solver.layout());
  const Vector<Patient> up(0, 0, 1);
  const auto press = [&](double x, double depth_mm) {
    return press_sphere(grid, solver, Point<Patient>(x, cells / 2.0 + 0.3, top), up, kRadius_mm, depth_mm,
                        unit, load, kMaxTissueIterations, 1e-5);
  };
  // energy stored by a press to kDepth_mm at a position: the force integrated over depth by the midpoint rule
  const auto energy = [&](double x) {
    double sum = 0;
    constexpr int kDepths = 24;
    for (int n = 0; n < kDepths; ++n) sum += press(x, kDepth_mm * (n + 0.5) / kDepths).force_N;
    return sum * kDepth_mm / kDepths;
  };
  const double first = cells / 2.0 - 7.15, last = cells / 2.0 + 0.35;
  double along = 0, side = 0, over = 0;
  for (int n = 0; n < steps; ++n) {
    const SphereContact contact = press(first + (last - first) * (n + 0.5) / steps, kDepth_mm);
    along += contact.tangential_N.x() * (last - first) / steps;
    if (n == 0) side = contact.force_N;
    over = contact.force_N;
  }
  const double at_first = energy(first), at_last = energy(last);
  // down at the first position, along, up at the last: the work done by the tissue along the path is the loss
  // of its stored energy
  NoduleLoop result;
  result.error_percent = 100 * (at_first - at_last - along) / at_last;
  result.error_without_tangential_percent = 100 * (at_first - at_last) / at_last;
  result.stiffer_percent = 100 * (over / side - 1);
  return result;
}

}  // namespace palpate
