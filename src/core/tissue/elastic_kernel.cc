#include "tissue/elastic_kernel.h"
#include "palpate/tissue/elastic_grid.h"

// The stiffness of a cube by the Walsh transform of its eight corners (docs/concepts/tissue.md).
//
//     w_m = sum over corners c of H_m(c) u_c         m: bits x, y, z; H_m(c): product over the bits of m of
//                                                   -1 where c has the lower coordinate, 1 elsewhere
//     w_x, w_y, w_z (m = 1, 2, 4)                    4 h times the displacement gradient at the centre
//     w_3, w_5, w_6, w_7                             hourglass modes, which do not affect that gradient
//     w_0                                            8 times the mean displacement: no force
//
//     p_x, p_y, p_z = mu (G + G^T) + lambda tr(G) I, G = (w_x, w_y, w_z), columns; mu and lambda times h / 16
//     p_m           = kHourglass mu w_m              for the four hourglass modes
//     f_c           = sum over m of H_m(c) p_m
//
// Neo-Hookean (Smith et al. 2018, without the barrier): energy mu / 2 (F : F - 3) - mu (J - 1) + (lambda +
// mu) / 2 (J - 1)^2,
//
//     F = I + G / (4 h),  J = det F,  C = dJ / dF (cofactor matrix), whose columns are cross products of F's
//     p / (4 h)       = mu F + s C,   s = (lambda + mu) (J - 1) - mu
//     dp              = mu dG + (lambda + mu) (C : dG) C + s dC
//
// Stiffening (Fung 1967; Demiray 1972), exponent b: U is the energy above plus that of the hourglass modes,
// and q its p; energy mu / (2 b) (exp(x) - 1) with x = 2 b U / mu,
//
//     p               = exp(x) q
//     dp              = exp(x) (dq + q dx)
//
// Cells are processed in rows along x. A cell contributes to the nodes at its left and right corners; a node
// sums the contributions of the cells before and after it. Both halves of a row are stored first and then
// summed node by node, so that the order of summation does not depend on the number of lanes. No fused
// multiply-add is used. Hence the results are bit-identical on every target.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tissue/elastic_kernel.cc"
#include <hwy/foreach_target.h>
// must follow foreach_target.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::elastic::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, ElasticLayout::kLanes>;
using V = hn::Vec<D>;

// the four rows of nodes around a row of cells, at (y, z) = (0, 0), (1, 0), (0, 1), (1, 1)
struct NodeRows {
  std::size_t at[4];
};

HWY_INLINE NodeRows node_rows(const ElasticLayout& layout, int j, int k) {
  return {{layout.node(0, j, k, 0), layout.node(0, j + 1, k, 0), layout.node(0, j, k + 1, 0),
           layout.node(0, j + 1, k + 1, 0)}};
}

// w_1 ... w_7 of one component; w[0] is not computed
HWY_INLINE void transform(const float* u, const NodeRows& rows, std::size_t offset, V* w) {
  const D d;
  V even[4], odd[4];
  for (int r = 0; r < 4; ++r) {
    const float* p = u + rows.at[r] + offset;
    const V left = hn::Load(d, p), right = hn::LoadU(d, p + 1);
    even[r] = hn::Add(right, left);
    odd[r] = hn::Sub(right, left);
  }
  const V even_y0 = hn::Add(even[1], even[0]), even_y1 = hn::Add(even[3], even[2]);
  const V even_o0 = hn::Sub(even[1], even[0]), even_o1 = hn::Sub(even[3], even[2]);
  const V odd_y0 = hn::Add(odd[1], odd[0]), odd_y1 = hn::Add(odd[3], odd[2]);
  const V odd_o0 = hn::Sub(odd[1], odd[0]), odd_o1 = hn::Sub(odd[3], odd[2]);
  w[1] = hn::Add(odd_y1, odd_y0);
  w[2] = hn::Add(even_o1, even_o0);
  w[3] = hn::Add(odd_o1, odd_o0);
  w[4] = hn::Sub(even_y1, even_y0);
  w[5] = hn::Sub(odd_y1, odd_y0);
  w[6] = hn::Sub(even_o1, even_o0);
  w[7] = hn::Sub(odd_o1, odd_o0);
}

// contributions of p_1 ... p_7 to the left and right corners of the four rows, one component
HWY_INLINE void transform_back(const V* p, float* left, float* right, std::size_t stride) {
  const D d;
  // by z, then y, then x: the low end subtracts the odd part
  const V zero_low = hn::Neg(p[4]), zero_high = p[4];
  const V y_low = hn::Sub(p[2], p[6]), y_high = hn::Add(p[2], p[6]);
  const V x_low = hn::Sub(p[1], p[5]), x_high = hn::Add(p[1], p[5]);
  const V xy_low = hn::Sub(p[3], p[7]), xy_high = hn::Add(p[3], p[7]);
  const V even[4] = {hn::Sub(zero_low, y_low), hn::Add(zero_low, y_low), hn::Sub(zero_high, y_high),
                     hn::Add(zero_high, y_high)};
  const V odd[4] = {hn::Sub(x_low, xy_low), hn::Add(x_low, xy_low), hn::Sub(x_high, xy_high),
                    hn::Add(x_high, xy_high)};
  for (int r = 0; r < 4; ++r) {
    hn::Store(hn::Sub(even[r], odd[r]), d, left + r * stride);
    // shifted by one node
    hn::StoreU(hn::Add(even[r], odd[r]), d, right + r * stride + 1);
  }
}

// sums both halves node by node; stores instead of adding for the first contribution to a row
HWY_INLINE void gather_row(const float* left, const float* right, int row, bool first, float* force) {
  const D d;
  for (int i = 0; i < row; i += static_cast<int>(hn::Lanes(d))) {
    V sum = hn::Add(hn::Load(d, left + i), hn::Load(d, right + i));
    if (!first) sum = hn::Add(hn::Load(d, force + i), sum);
    hn::Store(sum, d, force + i);
  }
}

// Zeroes forces of a node's constrained components. There is one byte of constraint bits per node.
HWY_INLINE void constrain_row(const std::uint8_t* constraints, int row, float* force) {
  const D d;
  const hn::Rebind<std::uint8_t, D> bytes;
  const hn::RebindToSigned<D> whole;
  for (int i = 0; i < row; i += static_cast<int>(hn::Lanes(d))) {
    const auto bits = hn::PromoteTo(whole, hn::LoadU(bytes, constraints + i));
    for (int c = 0; c < 3; ++c) {
      float* p = force + static_cast<std::size_t>(c) * row + i;
      const auto free =
          hn::Eq(hn::And(bits, hn::Set(whole, (1 << c) | ElasticGrid::kNoNode)), hn::Zero(whole));
      hn::Store(hn::IfThenElseZero(hn::RebindMask(d, free), hn::Load(d, p)), d, p);
    }
  }
}

// Adds the two halves of a row of cells to the four surrounding rows of nodes. A row of nodes is complete
// after the last row of cells around it.
HWY_INLINE void finish_cell_row(const Cells& cells, int j, int k, const NodeRows& rows, const float* left,
                                const float* right, std::size_t stride, float* force) {
  const ElasticLayout& layout = cells.layout;
  const std::size_t row = static_cast<std::size_t>(layout.row);
  const bool firsts[4] = {j == 0 && k == 0, k == 0, j == 0, true};
  for (int c = 0; c < 3; ++c)
    for (int r = 0; r < 4; ++r)
      gather_row(left + (4 * c + r) * stride, right + (4 * c + r) * stride, layout.row, firsts[r],
                 force + rows.at[r] + c * row);
  if (cells.constraints == nullptr) return;
  const bool last_j = j == layout.cells[1] - 1, last_k = k == layout.cells[2] - 1;
  const bool done[4] = {true, last_j, last_k, last_j && last_k};
  for (int r = 0; r < 4; ++r)
    if (done[r]) constrain_row(cells.constraints + rows.at[r] / 3, layout.row, force + rows.at[r]);
}

// For every vector of cells in every row, calls `stress` to turn the modes w_m of each displacement component
// into p_m in place, then gathers the forces.
template <class Stress>
HWY_INLINE void for_each_vector(const Cells& cells, const float* displacement, float* force,
                                const Stress& stress) {
  const D d;
  const ElasticLayout& layout = cells.layout;
  const std::size_t row = static_cast<std::size_t>(layout.row), stride = row + ElasticLayout::kLanes;
  float* const left = cells.scratch;
  float* const right = left + 12 * stride;
  // no cell precedes the first node
  for (int q = 0; q < 12; ++q) right[q * stride] = 0;
  for (int k = 0; k < layout.cells[2]; ++k) {
    for (int j = 0; j < layout.cells[1]; ++j) {
      const NodeRows rows = node_rows(layout, j, k);
      const std::size_t cell = layout.cell(0, j, k);
      for (std::size_t i = 0; i < row; i += hn::Lanes(d)) {
        V x[8], y[8], z[8];
        transform(displacement, rows, i, x);
        transform(displacement, rows, row + i, y);
        transform(displacement, rows, 2 * row + i, z);
        stress(rows, i, cell + i, x, y, z);
        transform_back(x, left + i, right + i, stride);
        transform_back(y, left + 4 * stride + i, right + 4 * stride + i, stride);
        transform_back(z, left + 8 * stride + i, right + 8 * stride + i, stride);
      }
      finish_cell_row(cells, j, k, rows, left, right, stride, force);
    }
  }
}

HWY_INLINE void hourglass_forces(V mu, V* x, V* y, V* z) {
  const V stiff = hn::Mul(mu, hn::Set(D(), kHourglass));
  for (const int m : {3, 5, 6, 7}) {
    x[m] = hn::Mul(stiff, x[m]);
    y[m] = hn::Mul(stiff, y[m]);
    z[m] = hn::Mul(stiff, z[m]);
  }
}

void linear(const Cells& cells, const float* displacement, float* force) {
  const D d;
  for_each_vector(cells, displacement, force,
                  [&](const NodeRows&, std::size_t, std::size_t cell, V* x, V* y, V* z) HWY_ATTR {
                    const V mu = hn::Load(d, cells.mu + cell), lambda = hn::Load(d, cells.lambda + cell);
                    const V two_mu = hn::Add(mu, mu);
                    const V pressure = hn::Mul(lambda, hn::Add(hn::Add(x[1], y[2]), z[4]));
                    const V xy = hn::Mul(mu, hn::Add(x[2], y[1])), xz = hn::Mul(mu, hn::Add(x[4], z[1])),
                            yz = hn::Mul(mu, hn::Add(y[4], z[2]));
                    x[1] = hn::Add(hn::Mul(two_mu, x[1]), pressure);
                    y[2] = hn::Add(hn::Mul(two_mu, y[2]), pressure);
                    z[4] = hn::Add(hn::Mul(two_mu, z[4]), pressure);
                    x[2] = y[1] = xy;
                    x[4] = z[1] = xz;
                    y[4] = z[2] = yz;
                    hourglass_forces(mu, x, y, z);
                  });
}

// 3 x 3 matrix, at[a][c]: column a (direction), component c
struct Matrix {
  V at[3][3];
};

HWY_INLINE V cross_part(const V* a, const V* b, int c) {
  const int e = (c + 1) % 3, f = (c + 2) % 3;
  return hn::Sub(hn::Mul(a[e], b[f]), hn::Mul(a[f], b[e]));
}

// deformation gradient F from the displacement modes
HWY_INLINE Matrix deformation(const V* x, const V* y, const V* z, V per_edge) {
  const D d;
  Matrix f;
  for (int a = 0; a < 3; ++a) {
    f.at[a][0] = hn::Mul(x[1 << a], per_edge);
    f.at[a][1] = hn::Mul(y[1 << a], per_edge);
    f.at[a][2] = hn::Mul(z[1 << a], per_edge);
    f.at[a][a] = hn::Add(f.at[a][a], hn::Set(d, 1.0f));
  }
  return f;
}

HWY_INLINE Matrix cofactors(const Matrix& f) {
  Matrix c;
  for (int a = 0; a < 3; ++a)
    for (int n = 0; n < 3; ++n) c.at[a][n] = cross_part(f.at[(a + 1) % 3], f.at[(a + 2) % 3], n);
  return c;
}

HWY_INLINE V determinant(const Matrix& f, const Matrix& cofactor) {
  return hn::Add(hn::Add(hn::Mul(f.at[0][0], cofactor.at[0][0]), hn::Mul(f.at[0][1], cofactor.at[0][1])),
                 hn::Mul(f.at[0][2], cofactor.at[0][2]));
}

void neo_hookean(const Cells& cells, float cell_mm, const float* displacement, float* force, float* volumes) {
  const D d;
  const V edges = hn::Set(d, 4 * cell_mm), per_edge = hn::Set(d, 1 / (4 * cell_mm)), one = hn::Set(d, 1.0f);
  for_each_vector(cells, displacement, force,
                  [&](const NodeRows&, std::size_t, std::size_t cell, V* x, V* y, V* z) HWY_ATTR {
                    const V mu = hn::Load(d, cells.mu + cell), lambda = hn::Load(d, cells.lambda + cell);
                    const Matrix f = deformation(x, y, z, per_edge), c = cofactors(f);
                    const V volume = determinant(f, c);
                    const V s = hn::Sub(hn::Mul(hn::Add(lambda, mu), hn::Sub(volume, one)), mu);
                    for (int a = 0; a < 3; ++a) {
                      V* const component[3] = {x, y, z};
                      for (int n = 0; n < 3; ++n)
                        component[n][1 << a] =
                            hn::Mul(edges, hn::Add(hn::Mul(mu, f.at[a][n]), hn::Mul(s, c.at[a][n])));
                    }
                    hourglass_forces(mu, x, y, z);
                    hn::Store(hn::IfThenElse(hn::Gt(mu, hn::Zero(d)), volume, one), d, volumes + cell);
                  });
}

void neo_hookean_tangent(const Cells& cells, float cell_mm, const float* base, const float* displacement,
                         float* force) {
  const D d;
  const std::size_t row = static_cast<std::size_t>(cells.layout.row);
  const V per_edge = hn::Set(d, 1 / (4 * cell_mm)), one = hn::Set(d, 1.0f);
  for_each_vector(cells, displacement, force,
                  [&](const NodeRows& rows, std::size_t i, std::size_t cell, V* x, V* y, V* z) HWY_ATTR {
                    V base_x[8], base_y[8], base_z[8];
                    transform(base, rows, i, base_x);
                    transform(base, rows, row + i, base_y);
                    transform(base, rows, 2 * row + i, base_z);
                    const V mu = hn::Load(d, cells.mu + cell), lambda = hn::Load(d, cells.lambda + cell);
                    const Matrix f = deformation(base_x, base_y, base_z, per_edge), c = cofactors(f);
                    const V bulk = hn::Add(lambda, mu);
                    const V s = hn::Sub(hn::Mul(bulk, hn::Sub(determinant(f, c), one)), mu);
                    Matrix g;
                    V change = hn::Zero(d);
                    V* const component[3] = {x, y, z};
                    for (int a = 0; a < 3; ++a)
                      for (int n = 0; n < 3; ++n) {
                        g.at[a][n] = component[n][1 << a];
                        change = hn::Add(change, hn::Mul(c.at[a][n], g.at[a][n]));
                      }
                    const V pressure = hn::Mul(bulk, change);
                    for (int a = 0; a < 3; ++a) {
                      const int b = (a + 1) % 3, e = (a + 2) % 3;
                      for (int n = 0; n < 3; ++n) {
                        const V cofactor_change =
                            hn::Add(cross_part(g.at[b], f.at[e], n), cross_part(f.at[b], g.at[e], n));
                        component[n][1 << a] =
                            hn::Add(hn::Add(hn::Mul(mu, g.at[a][n]), hn::Mul(pressure, c.at[a][n])),
                                    hn::Mul(s, cofactor_change));
                      }
                    }
                    hourglass_forces(mu, x, y, z);
                  });
}

// e^x by Cody and Waite's reduction and a Taylor polynomial: no library function is bit-identical everywhere.
// x is limited to the range of finite results with finite squares.
HWY_INLINE V exponential_of(V x) {
  const D d;
  const hn::RebindToSigned<D> whole;
  constexpr float kMax = 40, kPerLog2 = 1.44269504f, kLog2High = 0.693359375f, kLog2Low = -2.12194440e-4f;
  constexpr int kBias = 127, kMantissaBits = 23;
  x = hn::Min(hn::Max(x, hn::Set(d, -kMax)), hn::Set(d, kMax));
  const V n = hn::Round(hn::Mul(x, hn::Set(d, kPerLog2)));
  const V r = hn::Sub(hn::Sub(x, hn::Mul(n, hn::Set(d, kLog2High))), hn::Mul(n, hn::Set(d, kLog2Low)));
  V sum = hn::Set(d, 1.0f / 720);
  for (const float coefficient : {1.0f / 120, 1.0f / 24, 1.0f / 6, 0.5f, 1.0f, 1.0f})
    sum = hn::Add(hn::Mul(sum, r), hn::Set(d, coefficient));
  const auto exponent = hn::Add(hn::ConvertTo(whole, n), hn::Set(whole, kBias));
  return hn::Mul(sum, hn::BitCast(d, hn::ShiftLeft<kMantissaBits>(exponent)));
}

// neo-Hookean p of a vector of cells and the factor exp(x) of their stiffening
struct Stiffened {
  V factor;
  V per_mu;        ///< 1 / mu; finite where there is no tissue
  V stress[3][3];  ///< q / (4 h) of the modes x, y, z: [mode][component]
};

HWY_INLINE Stiffened stiffened(V mu, V lambda, V b, V per_edge, const Matrix& f, const Matrix& c, V volume,
                               const V* x, const V* y, const V* z) {
  const D d;
  const V one = hn::Set(d, 1.0f), bulk = hn::Add(lambda, mu), change = hn::Sub(volume, one);
  Stiffened to;
  to.per_mu = hn::Div(one, hn::Max(mu, hn::Set(d, 1e-30f)));
  const V s = hn::Sub(hn::Mul(bulk, change), mu);
  V squares = hn::Set(d, -3.0f), hourglass_energy = hn::Zero(d);
  for (int a = 0; a < 3; ++a)
    for (int n = 0; n < 3; ++n) {
      to.stress[a][n] = hn::Add(hn::Mul(mu, f.at[a][n]), hn::Mul(s, c.at[a][n]));
      squares = hn::Add(squares, hn::Mul(f.at[a][n], f.at[a][n]));
    }
  for (const int m : {3, 5, 6, 7})
    for (const V* const component : {x, y, z})
      hourglass_energy = hn::Add(hourglass_energy, hn::Mul(component[m], component[m]));
  hourglass_energy = hn::Mul(hn::Mul(hourglass_energy, hn::Set(d, kHourglass)), hn::Mul(per_edge, per_edge));
  const V volumetric = hn::Mul(hn::Mul(bulk, to.per_mu), hn::Mul(change, change));
  const V energy = hn::Add(hn::Add(hn::Sub(squares, hn::Add(change, change)), volumetric), hourglass_energy);
  to.factor = exponential_of(hn::Mul(b, energy));
  return to;
}

void exponential(const Cells& cells, float cell_mm, const float* displacement, float* force, float* volumes) {
  const D d;
  const V edges = hn::Set(d, 4 * cell_mm), per_edge = hn::Set(d, 1 / (4 * cell_mm)), one = hn::Set(d, 1.0f);
  for_each_vector(cells, displacement, force,
                  [&](const NodeRows&, std::size_t, std::size_t cell, V* x, V* y, V* z) HWY_ATTR {
                    const V mu = hn::Load(d, cells.mu + cell), lambda = hn::Load(d, cells.lambda + cell);
                    const Matrix f = deformation(x, y, z, per_edge), c = cofactors(f);
                    const V volume = determinant(f, c);
                    const Stiffened q = stiffened(mu, lambda, hn::Load(d, cells.stiffening + cell), per_edge,
                                                  f, c, volume, x, y, z);
                    V* const component[3] = {x, y, z};
                    for (int a = 0; a < 3; ++a)
                      for (int n = 0; n < 3; ++n)
                        component[n][1 << a] = hn::Mul(q.factor, hn::Mul(edges, q.stress[a][n]));
                    hourglass_forces(hn::Mul(q.factor, mu), x, y, z);
                    hn::Store(hn::IfThenElse(hn::Gt(mu, hn::Zero(d)), volume, one), d, volumes + cell);
                  });
}

void exponential_tangent(const Cells& cells, float cell_mm, const float* base, const float* displacement,
                         float* force) {
  const D d;
  const std::size_t row = static_cast<std::size_t>(cells.layout.row);
  const V edges = hn::Set(d, 4 * cell_mm), per_edge = hn::Set(d, 1 / (4 * cell_mm)), one = hn::Set(d, 1.0f);
  for_each_vector(
      cells, displacement, force,
      [&](const NodeRows& rows, std::size_t i, std::size_t cell, V* x, V* y, V* z) HWY_ATTR {
        V base_of[3][8];
        for (std::size_t n = 0; n < 3; ++n) transform(base, rows, n * row + i, base_of[n]);
        const V mu = hn::Load(d, cells.mu + cell), lambda = hn::Load(d, cells.lambda + cell),
                b = hn::Load(d, cells.stiffening + cell);
        const Matrix f = deformation(base_of[0], base_of[1], base_of[2], per_edge), c = cofactors(f);
        const V volume = determinant(f, c), bulk = hn::Add(lambda, mu);
        const Stiffened q =
            stiffened(mu, lambda, b, per_edge, f, c, volume, base_of[0], base_of[1], base_of[2]);
        const V s = hn::Sub(hn::Mul(bulk, hn::Sub(volume, one)), mu);
        Matrix g;
        V change = hn::Zero(d), work = hn::Zero(d);
        V* const component[3] = {x, y, z};
        for (int a = 0; a < 3; ++a)
          for (int n = 0; n < 3; ++n) {
            g.at[a][n] = component[n][1 << a];
            change = hn::Add(change, hn::Mul(c.at[a][n], g.at[a][n]));
            work = hn::Add(work, hn::Mul(q.stress[a][n], g.at[a][n]));
          }
        // hourglass modes: q = kHourglass mu w
        const V stiff = hn::Mul(mu, hn::Set(d, kHourglass));
        V hourglass_energy = hn::Zero(d);
        for (const int m : {3, 5, 6, 7})
          for (int n = 0; n < 3; ++n)
            hourglass_energy = hn::Add(hourglass_energy, hn::Mul(base_of[n][m], component[n][m]));
        work = hn::Add(work, hn::Mul(hn::Mul(stiff, hourglass_energy), per_edge));
        // dx = 2 b / mu dU, with work = sum of q . dw / (4 h)
        const V exponent_change = hn::Mul(hn::Mul(hn::Add(b, b), q.per_mu), hn::Mul(work, per_edge));
        const V pressure = hn::Mul(bulk, change);
        for (int a = 0; a < 3; ++a) {
          const int next = (a + 1) % 3, last = (a + 2) % 3;
          for (int n = 0; n < 3; ++n) {
            const V cofactor_change =
                hn::Add(cross_part(g.at[next], f.at[last], n), cross_part(f.at[next], g.at[last], n));
            const V neo_hookean = hn::Add(hn::Add(hn::Mul(mu, g.at[a][n]), hn::Mul(pressure, c.at[a][n])),
                                          hn::Mul(s, cofactor_change));
            component[n][1 << a] = hn::Mul(
                q.factor, hn::Add(neo_hookean, hn::Mul(exponent_change, hn::Mul(edges, q.stress[a][n]))));
          }
        }
        for (const int m : {3, 5, 6, 7})
          for (int n = 0; n < 3; ++n)
            component[n][m] = hn::Mul(hn::Mul(q.factor, stiff),
                                      hn::Add(component[n][m], hn::Mul(exponent_change, base_of[n][m])));
      });
}

}  // namespace palpate::internal::elastic::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::elastic {

HWY_EXPORT(linear);
HWY_EXPORT(neo_hookean);
HWY_EXPORT(neo_hookean_tangent);
HWY_EXPORT(exponential);
HWY_EXPORT(exponential_tangent);

void apply_linear(const Cells& cells, const float* displacement, float* force) {
  HWY_DYNAMIC_DISPATCH(linear)(cells, displacement, force);
}

void apply_neo_hookean(const Cells& cells, float cell_mm, const float* displacement, float* force,
                       float* volumes) {
  HWY_DYNAMIC_DISPATCH(neo_hookean)(cells, cell_mm, displacement, force, volumes);
}

void apply_neo_hookean_tangent(const Cells& cells, float cell_mm, const float* base,
                               const float* displacement, float* force) {
  HWY_DYNAMIC_DISPATCH(neo_hookean_tangent)(cells, cell_mm, base, displacement, force);
}

void apply_exponential(const Cells& cells, float cell_mm, const float* displacement, float* force,
                       float* volumes) {
  HWY_DYNAMIC_DISPATCH(exponential)(cells, cell_mm, displacement, force, volumes);
}

void apply_exponential_tangent(const Cells& cells, float cell_mm, const float* base,
                               const float* displacement, float* force) {
  HWY_DYNAMIC_DISPATCH(exponential_tangent)(cells, cell_mm, base, displacement, force);
}

}  // namespace palpate::internal::elastic
#endif  // HWY_ONCE
