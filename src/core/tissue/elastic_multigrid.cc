#include "tissue/elastic_multigrid.h"

#include <algorithm>
#include <cmath>

#include "tissue/each_cell.h"

namespace palpate::internal::elastic {
namespace {

/// Grids with at most this number of free values are factorised.
constexpr std::size_t kMaxFactorized = 400;
/// Degree of the smoother's Chebyshev polynomial.
constexpr int kChebyshevDegree = 3;
/// The smoother damps eigenvalues between this fraction of the greatest and the greatest.
constexpr double kSmoothedFrom = 0.1;
/// Power iterations for the greatest eigenvalue, and safety factor on their result.
constexpr int kPowerIterations = 15;
/// Power iterations in one step of Multigrid::prepare().
constexpr int kPowerIterationsPerStep = 5;
constexpr double kPowerMargin = 1.1;
/// Relative diagonal shift, so that a coarse body with nearly disconnected parts can be factorised.
constexpr double kRelativeDiagonalShift = 1e-6;

std::size_t node_number(const ElasticLayout& layout, int i, int j, int k) {
  return layout.node(0, j, k, 0) / 3 + static_cast<std::size_t>(i);
}

// fine nodes along an axis that coarse node `coarse` interpolates, with weights
template <class Visit>
void for_each_interpolated(int coarse, int cells, const Visit& visit) {
  for (int n = std::max(0, 2 * coarse - 1); n <= std::min(cells, 2 * coarse + 1); ++n)
    visit(n, n == 2 * coarse ? 1.0f : 0.5f);
}

// restriction: coarse = P^T fine
void restrict_to(const ElasticLayout& fine, const ElasticValues& from, const ElasticLayout& coarse,
                 const Operator& of_coarse, std::vector<float>& scratch, ElasticValues& to) {
  // one row, with one node of padding before it
  float* const row = scratch.data() + 1;
  for (int k = 0; k <= coarse.cells[2]; ++k)
    for (int j = 0; j <= coarse.cells[1]; ++j)
      for (int c = 0; c < 3; ++c) {
        std::fill(scratch.begin(), scratch.end(), 0.0f);
        for_each_interpolated(k, fine.cells[2], [&](int z, float along_z) {
          for_each_interpolated(j, fine.cells[1], [&](int y, float along_y) {
            const float weight = along_z * along_y;
            const float* p = from.data() + fine.node(0, y, z, c);
            for (int i = 0; i < fine.row; ++i) row[i] += weight * p[i];
          });
        });
        const std::size_t first = coarse.node(0, j, k, c);
        for (int i = 0; i <= coarse.cells[0]; ++i)
          to[first + i] =
              of_coarse.free(first + i) ? 0.5f * (row[2 * i - 1] + row[2 * i + 1]) + row[2 * i] : 0.0f;
      }
}

// prolongation: fine += P coarse, at free values
void prolong_to(const ElasticLayout& coarse, const ElasticValues& from, const ElasticLayout& fine,
                const Operator& of_fine, std::vector<float>& scratch, ElasticValues& to) {
  float* const row = scratch.data();
  const float* const free = of_fine.inverse_diagonal().data();
  for (int k = 0; k <= fine.cells[2]; ++k)
    for (int j = 0; j <= fine.cells[1]; ++j)
      for (int c = 0; c < 3; ++c) {
        const float* a = from.data() + coarse.node(0, j / 2, k / 2, c);
        const float* b = from.data() + coarse.node(0, (j + 1) / 2, k / 2, c);
        const float* p = from.data() + coarse.node(0, j / 2, (k + 1) / 2, c);
        const float* q = from.data() + coarse.node(0, (j + 1) / 2, (k + 1) / 2, c);
        for (int i = 0; i < coarse.row; ++i) row[i] = 0.25f * ((a[i] + b[i]) + (p[i] + q[i]));
        const std::size_t first = fine.node(0, j, k, c);
        float* const x = to.data() + first;
        const float* const is_free = free + first;
        for (int i = 0; i <= fine.cells[0]; ++i) {
          const float moved = 0.5f * (row[i / 2] + row[(i + 1) / 2]);
          x[i] += is_free[i] > 0 ? moved : 0.0f;
        }
      }
}

}  // namespace

double dot(const ElasticValues& a, const ElasticValues& b) {
  constexpr std::size_t kLanes = ElasticLayout::kLanes, kRun = 16 * kLanes;
  double sum = 0;
  for (std::size_t first = 0; first < a.size(); first += kRun) {
    const std::size_t end = std::min(a.size(), first + kRun);
    float lanes[kLanes] = {};
    for (std::size_t n = first; n < end; n += kLanes)
      for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] += a[n + lane] * b[n + lane];
    for (const float lane : lanes) sum += lane;
  }
  return sum;
}

Operator::Operator(const ElasticLayout& layout, double cell_mm, const ElasticValues& mu,
                   const ElasticValues& lambda, const ElasticValues& springs,
                   std::vector<std::uint8_t> constraints, const ElasticValues& stiffening)
    : constraints_(std::move(constraints)), cell_mm_(static_cast<float>(cell_mm)) {
  make_room(layout);
  change(mu, lambda, springs, constraints_, {{0, 0, 0}, layout.cells}, stiffening);
}

void Operator::make_room(const ElasticLayout& layout) {
  layout_ = layout;
  scratch_.resize(scratch_floats(layout));
  mu_.assign(layout.cell_values() + ElasticLayout::kSpare, 0.0f);
  lambda_ = mu_;
  volumes_.assign(mu_.size(), 1.0f);
  spring_of_node_.assign(layout.node_values() + ElasticLayout::kSpare, 0.0f);
  inverse_diagonal_ = spring_of_node_;
  constraints_.resize(layout.node_values() / 3 + ElasticLayout::kSpare, ElasticGrid::kNoNode);
}

void Operator::change(const ElasticValues& mu, const ElasticValues& lambda, const ElasticValues& springs,
                      const std::vector<std::uint8_t>& constraints, const CellBox& box,
                      const ElasticValues& stiffening) {
  const float scale = static_cast<float>(static_cast<double>(cell_mm_) / 16);
  for_each_cell(box, [&](int i, int j, int k) {
    const std::size_t cell = layout_.cell(i, j, k);
    mu_[cell] = mu[cell] * scale;
    lambda_[cell] = lambda[cell] * scale;
    // resets cells that are no longer, or not yet, soft
    volumes_[cell] = 1;
    const float exponent = stiffening.empty() ? 0 : stiffening[cell];
    if (exponent > 0 && stiffening_.empty()) stiffening_.assign(mu_.size(), 0.0f);
    if (!stiffening_.empty()) stiffening_[cell] = exponent;
  });
  for_each_node(box, [&](int i, int j, int k) {
    constraints_[node_number(layout_, i, j, k)] = constraints[node_number(layout_, i, j, k)];
    for (int c = 0; c < 3; ++c) spring_of_node_[layout_.node(i, j, k, c)] = springs[layout_.node(i, j, k, c)];
  });
  list_springs(box);
  find_inverse_diagonal(box);
}

// springs only exist on the faces of the grid
void Operator::list_springs(const CellBox& box) {
  bool any = false;
  for (int axis = 0; axis < 3; ++axis)
    any = any || box.low[axis] == 0 || box.high[axis] == layout_.cells[axis];
  if (!any) return;
  springs_.clear();
  for (std::size_t n = 0; n < layout_.node_values(); ++n)
    if (spring_of_node_[n] > 0) springs_.emplace_back(static_cast<std::uint32_t>(n), spring_of_node_[n]);
}

void Operator::find_inverse_diagonal(const CellBox& box) {
  for_each_node(box, [&](int i, int j, int k) {
    float of_cells = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const int x = i - 1 + (corner & 1), y = j - 1 + (corner >> 1 & 1), z = k - 1 + (corner >> 2 & 1);
      if (!layout_.contains_cell(x, y, z)) continue;
      const std::size_t cell = layout_.cell(x, y, z);
      // a component's normal strain, two shears, four hourglass modes
      of_cells += (4 + 4 * kHourglass) * mu_[cell] + lambda_[cell];
    }
    const int constraint_bits = constraints_[node_number(layout_, i, j, k)];
    for (int c = 0; c < 3; ++c) {
      const std::size_t value = layout_.node(i, j, k, c);
      const float spring = spring_of_node_[value], diagonal = spring > 0 ? of_cells + spring : of_cells;
      const bool is_free = (constraint_bits & (1 << c | ElasticGrid::kNoNode)) == 0 && diagonal > 0;
      inverse_diagonal_[value] = is_free ? 1 / diagonal : 0.0f;
    }
  });
}

// averages cells and constraints of the finer operator over a box of coarse cells
void Operator::average(const Operator& finer, const CellBox& box) {
  const ElasticLayout& fine = finer.layout_;
  // mean of eight moduli, times 2 for the edge length in the factor h / 16
  for_each_cell(box, [&](int i, int j, int k) {
    float mu = 0, lambda = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const int x = 2 * i + (corner & 1), y = 2 * j + (corner >> 1 & 1), z = 2 * k + (corner >> 2 & 1);
      if (!fine.contains_cell(x, y, z)) continue;
      mu += finer.mu_[fine.cell(x, y, z)] / 4;
      lambda += finer.lambda_[fine.cell(x, y, z)] / 4;
    }
    mu_[layout_.cell(i, j, k)] = mu;
    lambda_[layout_.cell(i, j, k)] = lambda;
  });
  for_each_node(box, [&](int i, int j, int k) {
    std::uint8_t constraints = ElasticGrid::kNoNode;
    for (int corner = 0; corner < 8; ++corner) {
      const int x = i - (corner & 1), y = j - (corner >> 1 & 1), z = k - (corner >> 2 & 1);
      if (layout_.contains_cell(x, y, z) && mu_[layout_.cell(x, y, z)] > 0) constraints = 0;
    }
    float springs[3] = {};
    for_each_interpolated(k, fine.cells[2], [&](int z, float along_z) {
      for_each_interpolated(j, fine.cells[1], [&](int y, float along_y) {
        for_each_interpolated(i, fine.cells[0], [&](int x, float along_x) {
          constraints = static_cast<std::uint8_t>(
              constraints | (finer.constraints_[node_number(fine, x, y, z)] & ElasticGrid::kFixed));
          for (int c = 0; c < 3; ++c)
            springs[c] += along_x * along_y * along_z * finer.spring_of_node_[fine.node(x, y, z, c)];
        });
      });
    });
    constraints_[node_number(layout_, i, j, k)] = constraints;
    for (int c = 0; c < 3; ++c) spring_of_node_[layout_.node(i, j, k, c)] = springs[c];
  });
  list_springs(box);
  find_inverse_diagonal(box);
}

Operator Operator::coarser() const {
  Operator to;
  to.make_room(
      ElasticLayout({(layout_.cells[0] + 1) / 2, (layout_.cells[1] + 1) / 2, (layout_.cells[2] + 1) / 2}));
  to.average(*this, {{0, 0, 0}, to.layout_.cells});
  return to;
}

CellBox Operator::update(const Operator& finer, const CellBox& changed) {
  CellBox box;
  for (int axis = 0; axis < 3; ++axis) {
    // a coarse node interpolates fine nodes up to one coarse cell before and after it
    box.low[axis] = changed.low[axis] / 2 - 1;
    box.high[axis] = (changed.high[axis] + 1) / 2 + 1;
  }
  box = box.clipped(layout_.cells);
  average(finer, box);
  return box;
}

Operator Operator::part(const CellBox& box) const {
  Operator to;
  to.make_room(ElasticLayout({box.high[0] - box.low[0], box.high[1] - box.low[1], box.high[2] - box.low[2]}));
  for_each_cell(box, [&](int i, int j, int k) {
    const std::size_t cell = to.layout_.cell(i - box.low[0], j - box.low[1], k - box.low[2]);
    to.mu_[cell] = mu_[layout_.cell(i, j, k)];
    to.lambda_[cell] = lambda_[layout_.cell(i, j, k)];
  });
  for_each_node(box, [&](int i, int j, int k) {
    const std::array<int, 3> node{i, j, k};
    bool inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      const bool low = node[axis] == box.low[axis] && box.low[axis] > 0;
      const bool high = node[axis] == box.high[axis] && box.high[axis] < layout_.cells[axis];
      inside = inside && !low && !high;
    }
    const int a = i - box.low[0], b = j - box.low[1], c = k - box.low[2];
    to.constraints_[node_number(to.layout_, a, b, c)] =
        inside ? constraints_[node_number(layout_, i, j, k)] : ElasticGrid::kFixed;
    for (int component = 0; component < 3; ++component)
      to.spring_of_node_[to.layout_.node(a, b, c, component)] =
          spring_of_node_[layout_.node(i, j, k, component)];
  });
  const CellBox all{{0, 0, 0}, to.layout_.cells};
  to.list_springs(all);
  to.find_inverse_diagonal(all);
  return to;
}

std::size_t Operator::free_values() const {
  return static_cast<std::size_t>(
      std::count_if(inverse_diagonal_.begin(), inverse_diagonal_.end(), [](float one) { return one > 0; }));
}

Cells Operator::cells(const std::uint8_t* constraints) {
  return {layout_, mu_.data(), lambda_.data(), stiffening_.data(), constraints, scratch_.data()};
}

void Operator::add_springs(bool include_constrained, const ElasticValues& displacement,
                           ElasticValues& force) const {
  for (const auto& [value, spring] : springs_)
    if (include_constrained || free(value)) force[value] += spring * displacement[value];
}

void Operator::apply(const std::uint8_t* constraints, const ElasticValues& displacement,
                     ElasticValues& force) {
  apply_linear(cells(constraints), displacement.data(), force.data());
  add_springs(constraints == nullptr, displacement, force);
}

void Operator::apply_finite_strain(const std::uint8_t* constraints, const ElasticValues& displacement,
                                   ElasticValues& force) {
  const auto apply = stiffening_.empty() ? apply_neo_hookean : apply_exponential;
  apply(cells(constraints), cell_mm_, displacement.data(), force.data(), volumes_.data());
  add_springs(constraints == nullptr, displacement, force);
}

float Operator::apply_finite_strain(const ElasticValues& displacement, ElasticValues& force) {
  apply_finite_strain(constraints_.data(), displacement, force);
  // NaN counts as the least
  float smallest = 1;
  for (const float volume : volumes_) smallest = volume >= smallest ? smallest : volume;
  return smallest;
}

void Operator::apply_finite_strain_everywhere(const ElasticValues& displacement, ElasticValues& force) {
  apply_finite_strain(nullptr, displacement, force);
}

void Operator::apply_tangent(const ElasticValues& base, const ElasticValues& displacement,
                             ElasticValues& force) {
  const auto apply = stiffening_.empty() ? apply_neo_hookean_tangent : apply_exponential_tangent;
  apply(cells(constraints_.data()), cell_mm_, base.data(), displacement.data(), force.data());
  add_springs(false, displacement, force);
}

void Operator::apply(const ElasticValues& displacement, ElasticValues& force) {
  apply(constraints_.data(), displacement, force);
}

void Operator::apply_everywhere(const ElasticValues& displacement, ElasticValues& force) {
  apply(nullptr, displacement, force);
}

Multigrid::Level::Level(Operator with) : k(std::move(with)) {
  const std::size_t values = k.layout().node_values() + ElasticLayout::kSpare;
  for (ElasticValues* field : {&x, &b, &residual, &step, &product}) field->assign(values, 0.0f);
}

Multigrid::Multigrid(Operator finest) {
  levels_.emplace_back(std::move(finest));
}

bool Multigrid::prepare() {
  if (is_prepared_) return true;
  if (row_.empty()) {
    while (levels_.back().k.free_values() > kMaxFactorized && levels_.back().k.can_be_coarser())
      levels_.emplace_back(levels_.back().k.coarser());
    row_.assign(static_cast<std::size_t>(2) * levels_.front().k.layout().row + 2 * ElasticLayout::kLanes,
                0.0f);
  } else if (bounded_levels_ < levels_.size()) {
    Level& level = levels_[bounded_levels_];
    if (advance(level, power_, kPowerIterationsPerStep)) {
      level.max_eigenvalue = kPowerMargin * std::exchange(power_, {}).largest;
      ++bounded_levels_;
    }
  } else {
    factorize();
    is_prepared_ = true;
  }
  return is_prepared_;
}

void Multigrid::update(const CellBox& changed) {
  // only eigenmodes near the change can exceed the bound
  constexpr int kAround = 2;
  CellBox box = changed;
  for (std::size_t n = 0; n < levels_.size(); ++n) {
    Level& level = levels_[n];
    if (n > 0) box = level.k.update(levels_[n - 1].k, box);
    Level near(level.k.part(box.grown(kAround).clipped(level.k.layout().cells)));
    level.max_eigenvalue = std::max(level.max_eigenvalue, kPowerMargin * max_eigenvalue(near));
  }
  factorize();
}

bool Multigrid::advance(Level& level, PowerIteration& power, int iterations) {
  if (power.iterations == 0) {
    // fixed pseudo-random start vector, which contains all modes
    std::uint32_t state = 12345;
    for (std::size_t n = 0; n < level.x.size(); ++n) {
      state = state * 1664525u + 1013904223u;
      level.x[n] = level.k.free(n) ? static_cast<float>(state >> 8) / (1 << 23) - 1 : 0.0f;
    }
  }
  const ElasticValues& inverse = level.k.inverse_diagonal();
  const int end = std::min(power.iterations + iterations, kPowerIterations);
  for (; power.iterations < end; ++power.iterations) {
    level.k.apply(level.x, level.product);
    double of_k = 0, of_diagonal = 0;
    for (std::size_t m = 0; m < level.x.size(); ++m) {
      if (inverse[m] == 0) continue;
      of_k += static_cast<double>(level.x[m]) * level.product[m];
      of_diagonal += static_cast<double>(level.x[m]) * level.x[m] / inverse[m];
    }
    if (!(of_diagonal > 0)) return true;
    power.largest = of_k / of_diagonal;
    const float scale = static_cast<float>(1 / power.largest);
    for (std::size_t m = 0; m < level.x.size(); ++m) level.x[m] = scale * inverse[m] * level.product[m];
  }
  return power.iterations == kPowerIterations;
}

double Multigrid::max_eigenvalue(Level& level) {
  PowerIteration power;
  advance(level, power, kPowerIterations);
  return power.largest;
}

void Multigrid::factorize() {
  Level& level = levels_.back();
  coarsest_.clear();
  for (std::size_t n = 0; n < level.x.size(); ++n)
    if (level.k.free(n)) coarsest_.push_back(n);
  const Eigen::Index size = static_cast<Eigen::Index>(coarsest_.size());
  coarsest_k_.resize(size, size);
  std::fill(level.x.begin(), level.x.end(), 0.0f);
  for (Eigen::Index column = 0; column < size; ++column) {
    level.x[coarsest_[column]] = 1;
    level.k.apply(level.x, level.product);
    level.x[coarsest_[column]] = 0;
    for (Eigen::Index row = 0; row < size; ++row) coarsest_k_(row, column) = level.product[coarsest_[row]];
  }
  coarsest_k_.diagonal() *= 1 + kRelativeDiagonalShift;
  factors_.compute(coarsest_k_);
  coarsest_x_.resize(size);
}

void Multigrid::solve_coarsest(const ElasticValues& b, ElasticValues& x) {
  for (std::size_t n = 0; n < coarsest_.size(); ++n)
    coarsest_x_[static_cast<Eigen::Index>(n)] = b[coarsest_[n]];
  factors_.matrixL().solveInPlace(coarsest_x_);
  factors_.matrixU().solveInPlace(coarsest_x_);
  for (std::size_t n = 0; n < coarsest_.size(); ++n)
    x[coarsest_[n]] = static_cast<float>(coarsest_x_[static_cast<Eigen::Index>(n)]);
}

void Multigrid::smooth(Level& level, const ElasticValues& b, ElasticValues& x, bool from_zero,
                       bool residual_needed) {
  const std::size_t values = b.size();
  const float* const inverse = level.k.inverse_diagonal().data();
  float* const r = level.residual.data();
  float* const d = level.step.data();
  float* const p = x.data();
  const float* const product = level.product.data();
  // Chebyshev iteration over [kSmoothedFrom, 1] max_eigenvalue (Saad, Iterative Methods, algorithm 12.1)
  const double midpoint = level.max_eigenvalue * (1 + kSmoothedFrom) / 2,
               half = level.max_eigenvalue * (1 - kSmoothedFrom) / 2;
  const double sigma = midpoint / half;
  double rho = 1 / sigma;
  if (!from_zero) level.k.apply(x, level.product);
  const float first = static_cast<float>(1 / midpoint);
  for (std::size_t n = 0; n < values; ++n) {
    r[n] = from_zero ? b[n] : b[n] - product[n];
    d[n] = first * inverse[n] * r[n];
    p[n] = from_zero ? d[n] : p[n] + d[n];
  }
  for (int degree = 1; degree < kChebyshevDegree; ++degree) {
    level.k.apply(level.step, level.product);
    const double next = 1 / (2 * sigma - rho);
    const float momentum = static_cast<float>(next * rho), add = static_cast<float>(2 * next / half);
    rho = next;
    for (std::size_t n = 0; n < values; ++n) {
      r[n] -= product[n];
      d[n] = momentum * d[n] + add * inverse[n] * r[n];
      p[n] += d[n];
    }
  }
  if (!residual_needed) return;
  level.k.apply(level.step, level.product);
  for (std::size_t n = 0; n < values; ++n) r[n] -= product[n];
}

void Multigrid::cycle(std::size_t number, const ElasticValues& b, ElasticValues& x) {
  Level& level = levels_[number];
  if (number + 1 == levels_.size()) return solve_coarsest(b, x);
  Level& coarse = levels_[number + 1];
  smooth(level, b, x, true, true);
  restrict_to(level.k.layout(), level.residual, coarse.k.layout(), coarse.k, row_, coarse.b);
  cycle(number + 1, coarse.b, coarse.x);
  prolong_to(coarse.k.layout(), coarse.x, level.k.layout(), level.k, row_, x);
  smooth(level, b, x, false, false);
}

void Multigrid::cycle(const ElasticValues& r, ElasticValues& z) {
  cycle(0, r, z);
}

}  // namespace palpate::internal::elastic
