#include "lint/test_planted_faults.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "palpate/phantoms/phantoms.h"

namespace palpate::test {
namespace {

using Index = std::array<int, 3>;
using Random = std::mt19937;

int integer_between(Random& random, int low, int high) {
  return std::uniform_int_distribution<int>(low, high)(random);
}

double real(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

Volume<LabelId>& voxels_of(LintCase& one) {
  return one.labels.layers.front();
}

Index plus(const Index& at, std::size_t axis, int steps) {
  Index moved = at;
  moved[axis] += steps;
  return moved;
}

LabelId& label_at(LintCase& one, const Index& at) {
  return voxels_of(one).at(at[0], at[1], at[2]);
}

bool is_inside(const LintCase& one, const Index& at, int margin = 0) {
  const auto& dims = one.labels.geometry().dims;
  for (std::size_t a = 0; a < 3; ++a)
    if (at[a] < margin || at[a] >= dims[a] - margin) return false;
  return true;
}

template <class Visit>
void for_each_in_box(const Index& centre, int radius, const Visit& visit) {
  for (int k = -radius; k <= radius; ++k)
    for (int j = -radius; j <= radius; ++j)
      for (int i = -radius; i <= radius; ++i)
        visit(Index{centre[0] + i, centre[1] + j, centre[2] + k},
              std::sqrt(static_cast<double>(i * i + j * j + k * k)));
}

/// Whether all voxels of a box have that label.
bool is_uniform(LintCase& one, const Index& centre, int radius, LabelId label) {
  if (!is_inside(one, centre, radius + 1)) return false;
  bool uniform = true;
  for_each_in_box(centre, radius,
                  [&](const Index& at, double) { uniform = uniform && label_at(one, at) == label; });
  return uniform;
}

std::optional<Index> free_box(LintCase& one, Random& random, int radius) {
  const auto& dims = one.labels.geometry().dims;
  for (int attempt = 0; attempt < 20000; ++attempt) {
    Index at;
    for (std::size_t a = 0; a < 3; ++a)
      at[a] = integer_between(random, radius + 2, std::max(radius + 2, dims[a] - radius - 3));
    if (is_uniform(one, at, radius, 0)) return at;
  }
  return std::nullopt;
}

/// A random voxel whose surrounding box of that radius lies within one structure, and that structure.
std::optional<std::pair<Index, LabelId>> inner_box(LintCase& one, Random& random, int radius) {
  const auto& dims = one.labels.geometry().dims;
  for (int attempt = 0; attempt < 20000; ++attempt) {
    Index at;
    for (std::size_t a = 0; a < 3; ++a) at[a] = integer_between(random, radius + 1, dims[a] - radius - 2);
    const LabelId label = label_at(one, at);
    if (label != 0 && is_uniform(one, at, radius, label)) return std::pair(at, label);
  }
  return std::nullopt;
}

LabelId add_structure(LintCase& one, const std::string& name) {
  const auto id = static_cast<LabelId>(one.labels.segments.back().id + 1);
  one.labels.segments.push_back({id, name, {200, 200, 90}, 0, id});
  return id;
}

using Planted = std::optional<std::vector<LabelId>>;

Planted leaky_sheet(LintCase& one, Random& random) {
  const auto at = free_box(one, random, 5);
  if (!at) return std::nullopt;
  const LabelId id = add_structure(one, "fascia");
  const int half = integer_between(random, 3, 5), mirrored = integer_between(random, 0, 1);
  const auto u = static_cast<std::size_t>(integer_between(random, 0, 2)), v = (u + 1) % 3, w = (u + 2) % 3;
  for (int p = -half; p <= half; ++p)
    for (int q = -half; q <= half; ++q)
      label_at(one, plus(plus(plus(*at, u, p), v, mirrored ? -p : p), w, q)) = id;
  return std::vector{id};
}

Planted one_voxel_sheet(LintCase& one, Random& random) {
  const auto at = free_box(one, random, 5);
  if (!at) return std::nullopt;
  const LabelId id = add_structure(one, "membrane");
  const auto u = static_cast<std::size_t>(integer_between(random, 0, 2)), v = (u + 1) % 3;
  const int p_half = integer_between(random, 3, 5), q_half = integer_between(random, 3, 5);
  for (int p = -p_half; p <= p_half; ++p)
    for (int q = -q_half; q <= q_half; ++q) label_at(one, plus(plus(*at, u, p), v, q)) = id;
  return std::vector{id};
}

/// The first free voxel along an axis from a voxel deep in a structure, if enough free space follows.
struct ExitLine {
  Index surface;
  LabelId id;
  std::size_t axis;
  int step;
};
std::optional<ExitLine> path_out(LintCase& one, Random& random, int deep, int room, int room_at) {
  for (int attempt = 0; attempt < 300; ++attempt) {
    const auto inside = inner_box(one, random, deep);
    if (!inside) return std::nullopt;
    const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2));
    const int step = integer_between(random, 0, 1) ? 1 : -1;
    Index at = inside->first;
    while (is_inside(one, at) && label_at(one, at) == inside->second) at[axis] += step;
    if (!is_inside(one, at) || label_at(one, at) != 0) continue;
    if (room == 0 || is_uniform(one, plus(at, axis, step * room_at), room, 0))
      return ExitLine{at, inside->second, axis, step};
  }
  return std::nullopt;
}

Planted neck(LintCase& one, Random& random) {
  const int radius = integer_between(random, 3, 4), length = integer_between(random, 2, 3),
            thick = integer_between(random, 1, 2);
  const auto path = path_out(one, random, 2, radius + 1, length + radius);
  if (!path) return std::nullopt;
  const std::size_t across = (path->axis + 1) % 3;
  for (int n = -1; n <= length + 1; ++n)
    for (int t = 0; t < thick; ++t)
      label_at(one, plus(plus(path->surface, path->axis, path->step * n), across, t)) = path->id;
  for_each_in_box(plus(path->surface, path->axis, path->step * (length + radius)), radius,
                  [&](const Index& at, double off) {
                    if (off <= radius + 0.2) label_at(one, at) = path->id;
                  });
  return std::vector{path->id};
}

Planted open_cavity(LintCase& one, Random& random) {
  const auto path = path_out(one, random, 4, 0, 0);
  if (!path) return std::nullopt;
  // centre of the cavity, on the same line inside the structure
  constexpr int kRadius = 3;
  const int depth = kRadius + 2 + integer_between(random, 0, 1);
  const Index centre = plus(path->surface, path->axis, -path->step * depth);
  if (!is_inside(one, centre, kRadius + 1) || !is_uniform(one, centre, kRadius - 1, path->id))
    return std::nullopt;
  bool whole_wall = true;
  for_each_in_box(centre, kRadius + 1, [&](const Index& at, double off) {
    if (off <= kRadius + 1.2) whole_wall = whole_wall && label_at(one, at) == path->id;
  });
  if (!whole_wall) return std::nullopt;
  for_each_in_box(centre, kRadius, [&](const Index& at, double off) {
    if (off <= kRadius + 0.2) label_at(one, at) = 0;
  });
  for (int n = 1; n <= depth; ++n) label_at(one, plus(path->surface, path->axis, -path->step * n)) = 0;
  return std::vector{path->id};
}

Planted islands(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 3);
  if (!inside) return std::nullopt;
  const int count = integer_between(random, 1, 4);
  for (int n = 0; n < count; ++n) {
    const auto at = free_box(one, random, 3);
    if (!at) return std::nullopt;
    const int size = integer_between(random, 1, 3);
    for (int p = 0; p < size; ++p) label_at(one, plus(*at, 0, p)) = inside->second;
  }
  return std::vector{inside->second};
}

Planted holes(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 3);
  if (!inside) return std::nullopt;
  const int size = integer_between(random, 1, 3);
  const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2));
  for (int p = 0; p < size; ++p) label_at(one, plus(inside->first, axis, p - 1)) = 0;
  return std::vector{inside->second};
}

Planted narrow_gap(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 4);
  if (!inside) return std::nullopt;
  const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2));
  const auto& dims = one.labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const Index at{i, j, k};
        if (at[axis] == inside->first[axis] && label_at(one, at) == inside->second) label_at(one, at) = 0;
      }
  return std::vector{inside->second};
}

Planted seam(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 4);
  if (!inside) return std::nullopt;
  const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2)), along = (axis + 1) % 3;
  const int shift = integer_between(random, 3, 4) * (integer_between(random, 0, 1) ? 1 : -1);
  const LintCase before = one;
  const auto& dims = one.labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const Index at{i, j, k}, from = plus(at, along, shift);
        if (at[axis] < inside->first[axis]) continue;
        label_at(one, at) =
            is_inside(one, from) ? before.labels.layers.front().at(from[0], from[1], from[2]) : LabelId{0};
      }
  // any structure that crosses the plane
  return std::vector<LabelId>();
}

Planted terraces(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 4);
  if (!inside) return std::nullopt;
  const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2));
  const int step = integer_between(random, 2, 3);
  const auto& dims = one.labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const Index at{i, j, k};
        label_at(one, at) = label_at(one, plus(at, axis, -(at[axis] % step)));
      }
  return std::vector{inside->second};
}

Planted swapped_sides(LintCase& one, Random& random) {
  const bool kidneys = integer_between(random, 0, 1) != 0;
  Segment *left = nullptr, *right = nullptr;
  for (Segment& segment : one.labels.segments) {
    if (segment.name == (kidneys ? "left kidney" : "adrenal_gland_left")) left = &segment;
    if (segment.name == (kidneys ? "right kidney" : "adrenal_gland_right")) right = &segment;
  }
  if (left == nullptr || right == nullptr) return std::nullopt;
  std::swap(left->name, right->name);
  return std::vector{left->id, right->id};
}

Planted mirrored(LintCase& one, Random&) {
  bool has_pair = false;
  for (const Segment& segment : one.labels.segments) has_pair = has_pair || segment.name == "left kidney";
  if (!has_pair) return std::nullopt;
  auto& voxels = voxels_of(one);
  const auto& dims = voxels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j) {
      LabelId* row = voxels.voxels().data() + voxels.geometry().offset(0, j, k);
      std::reverse(row, row + dims[0]);
    }
  return std::vector<LabelId>();
}

Planted cut_by_border(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 3);
  if (!inside) return std::nullopt;
  const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2));
  const auto crop = [&](const auto& volume) {
    using Value = std::decay_t<decltype(volume.voxels().front())>;
    GridGeometry grid = volume.geometry();
    Eigen::Vector3d first = Eigen::Vector3d::Zero();
    first[static_cast<Eigen::Index>(axis)] = inside->first[axis];
    grid.origin = grid.X_PatientVoxel() * Point<Voxel>(first);
    grid.dims[axis] -= inside->first[axis];
    Volume<Value> cropped(grid);
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i) {
          const Index from = plus({i, j, k}, axis, inside->first[axis]);
          cropped.at(i, j, k) = volume.at(from[0], from[1], from[2]);
        }
    return cropped;
  };
  voxels_of(one) = crop(voxels_of(one));
  one.scan = crop(one.scan);
  return std::vector{inside->second};
}

Planted overlap(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 3);
  if (!inside) return std::nullopt;
  // a ball centred on the surface of the structure
  Index at = inside->first;
  const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2));
  while (is_inside(one, at, 6) && label_at(one, at) == inside->second) ++at[axis];
  if (!is_inside(one, at, 5) || label_at(one, at) == inside->second) return std::nullopt;
  const LabelId id = add_structure(one, "tumour");
  one.labels.segments.back().layer = 1;
  one.labels.segments.back().value = 1;
  one.labels.layers.emplace_back(one.labels.geometry());
  const int radius = integer_between(random, 3, 4);
  for_each_in_box(at, radius, [&](const Index& voxel, double off) {
    if (off <= radius + 0.2) one.labels.layers[1].at(voxel[0], voxel[1], voxel[2]) = 1;
  });
  return std::vector{inside->second, id};
}

Segment& any_segment(LintCase& one, Random& random) {
  return one.labels.segments[static_cast<std::size_t>(
      integer_between(random, 0, static_cast<int>(one.labels.segments.size()) - 1))];
}

Planted no_name(LintCase& one, Random& random) {
  Segment& segment = any_segment(one, random);
  segment.name.clear();
  return std::vector{segment.id};
}

Planted duplicate_name(LintCase& one, Random& random) {
  Segment& segment = any_segment(one, random);
  Segment& other =
      segment.id == one.labels.segments.front().id ? one.labels.segments.back() : one.labels.segments.front();
  segment.name = other.name;
  if (integer_between(random, 0, 1) != 0)
    for (char& c : segment.name) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return std::vector{segment.id, other.id};
}

Planted no_voxels(LintCase& one, Random& random) {
  const LabelId id = any_segment(one, random).id;
  for (LabelId& value : voxels_of(one).voxels())
    if (value == id) value = 0;
  return std::vector{id};
}

Planted outside_body(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 3);
  if (!inside) return std::nullopt;
  const auto& dims = one.labels.geometry().dims;
  const int radius = integer_between(random, 3, 4);
  for (int attempt = 0; attempt < 5000; ++attempt) {
    Index at;
    for (std::size_t a = 0; a < 3; ++a) at[a] = integer_between(random, radius + 1, dims[a] - radius - 2);
    bool is_air = true;
    for_each_in_box(at, radius + 1, [&](const Index& voxel, double) {
      is_air =
          is_air && one.scan.at(voxel[0], voxel[1], voxel[2]) < one.air_below && label_at(one, voxel) == 0;
    });
    if (!is_air) continue;
    for_each_in_box(at, radius, [&](const Index& voxel, double off) {
      if (off <= radius + 0.2) label_at(one, voxel) = inside->second;
    });
    return std::vector{inside->second};
  }
  return std::nullopt;
}

Planted outside_scan(LintCase& one, Random& random) {
  const auto inside = inner_box(one, random, 3);
  if (!inside) return std::nullopt;
  const auto axis = static_cast<std::size_t>(integer_between(random, 0, 2));
  GridGeometry grid = one.scan.geometry();
  grid.dims[axis] = inside->first[axis];
  Volume<float> cropped(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) cropped.at(i, j, k) = one.scan.at(i, j, k);
  one.scan = std::move(cropped);
  return std::vector{inside->second};
}

Planted unreachable(LintCase& one, Random& random) {
  const auto at = free_box(one, random, 6);
  if (!at) return std::nullopt;
  const LabelId shell = add_structure(one, "bone shell"), core = add_structure(one, "core");
  const int inner = integer_between(random, 2, 3);
  for_each_in_box(*at, 6, [&](const Index& voxel, double off) {
    if (off <= inner)
      label_at(one, voxel) = core;
    else if (off >= 4 && off <= 6)
      label_at(one, voxel) = shell;
  });
  // a hole through the shell, too narrow for the tool
  if (integer_between(random, 0, 1) != 0)
    for (int n = 3; n <= 6; ++n) label_at(one, plus(*at, 0, n)) = 0;
  return std::vector{core};
}

}  // namespace

Result<LintReport> LintCase::report(double tool_radius_mm) const {
  LintOptions options;
  options.tool_radius_mm = tool_radius_mm;
  options.scan = &scan;
  options.is_hard = [](const std::string& name) { return name == "bone shell"; };
  return lint(labels, options);
}

LintCase organs_case(unsigned seed) {
  Random random(seed);
  GridGeometry grid;
  grid.dims = {72, 60, 62};
  grid.spacing_mm = Eigen::Vector3d::Constant(2);
  grid.origin = Point<Patient>(-71, -59, -61);
  struct Organ {
    const char* name;
    Eigen::Vector3d centre, radii;
  };
  const std::vector<Organ> organs{
      {"liver", {-31, -12, 20}, {23, 22, 21}},           {"spleen", {47, 8, 24}, {11, 14, 15}},
      {"stomach", {14, -26, 20}, {13, 12, 14}},          {"left kidney", {34, 14, -24}, {10, 9, 16}},
      {"right kidney", {-34, 16, -28}, {10, 9, 16}},     {"adrenal_gland_left", {18, 8, 8}, {6, 5, 6}},
      {"adrenal_gland_right", {-16, 16, -2}, {6, 5, 6}}, {"spine", {0, 37, 0}, {10, 10, 46}},
      {"bladder", {0, -14, -38}, {13, 12, 11}}};
  LintCase one{{{Volume<LabelId>(grid)}, {}}, Volume<float>(grid, -1000)};
  const auto offset = [&] { return real(random, -1.5, 1.5); };
  // each organ's transform to the unit ball
  std::vector<Eigen::Affine3d> X_BallPatient;
  for (const Organ& organ : organs) {
    const Eigen::Vector3d centre = organ.centre + Eigen::Vector3d(offset(), offset(), offset());
    const Eigen::Vector3d radii = organ.radii * real(random, 0.92, 1.04);
    const double turn = real(random, -0.15, 0.15);
    const Eigen::Matrix3d axes =
        Eigen::AngleAxisd(turn, Eigen::Vector3d(offset(), offset(), 2).normalized()).toRotationMatrix();
    Eigen::Affine3d X_PatientBall = Eigen::Affine3d::Identity();
    X_PatientBall.linear() = axes * radii.asDiagonal();
    X_PatientBall.translation() = centre;
    X_BallPatient.push_back(X_PatientBall.inverse());
    const auto id = static_cast<LabelId>(X_BallPatient.size());
    one.labels.segments.push_back({id, organ.name, {}, 0, id});
  }
  std::normal_distribution<float> noise(0, 15);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Point<Patient> at = X_PatientVoxel * Point<Voxel>(i, j, k);
        float& value = one.scan.at(i, j, k);
        const Eigen::Vector3d in_body =
            (at.eigen() - Eigen::Vector3d(0, 4, 0)).cwiseQuotient(Eigen::Vector3d(66, 54, 400));
        if (in_body.norm() < 1) value = 0;
        for (std::size_t n = 0; n < X_BallPatient.size(); ++n)
          if ((X_BallPatient[n] * at.eigen()).squaredNorm() < 1) {
            voxels_of(one).at(i, j, k) = static_cast<LabelId>(n + 1);
            value = 50;
          }
        value += noise(random);
      }
  return one;
}

LintCase knee_case(unsigned seed) {
  KneeParameters parameters;
  parameters.settings.spacing_mm = Eigen::Vector3d::Constant(0.9);
  parameters.settings.seed = seed;
  parameters.side = seed % 2 == 0 ? BodySide::kLeft : BodySide::kRight;
  auto phantom = make_phantom(PhantomParameters(parameters));
  PALPATE_CHECK(phantom.ok());
  const float brightest = *std::ranges::max_element(phantom->scan.voxels());
  return {std::move(phantom->labels), std::move(phantom->scan), 0.05f * brightest};
}

const std::vector<PlantedFault>& planted_faults() {
  static const std::vector<PlantedFault> all{{LintKind::kLeakySheet, "leaky sheet", leaky_sheet},
                                             {LintKind::kOneVoxelSheet, "one-voxel sheet", one_voxel_sheet},
                                             {LintKind::kNeck, "neck", neck},
                                             {LintKind::kOpenCavity, "open cavity", open_cavity},
                                             {LintKind::kIslands, "islands", islands},
                                             {LintKind::kHoles, "holes", holes},
                                             {LintKind::kNarrowGap, "narrow gap", narrow_gap},
                                             {LintKind::kSeam, "seam", seam},
                                             {LintKind::kTerraces, "terraces", terraces},
                                             {LintKind::kSwappedSides, "swapped sides", swapped_sides},
                                             {LintKind::kSwappedSides, "mirrored", mirrored},
                                             {LintKind::kCutByBorder, "cut by border", cut_by_border},
                                             {LintKind::kOverlap, "overlap", overlap},
                                             {LintKind::kNoName, "no name", no_name},
                                             {LintKind::kDuplicateName, "duplicate name", duplicate_name},
                                             {LintKind::kNoVoxels, "no voxels", no_voxels},
                                             {LintKind::kOutsideBody, "outside body", outside_body},
                                             {LintKind::kOutsideScan, "outside scan", outside_scan},
                                             {LintKind::kUnreachable, "unreachable", unreachable}};
  return all;
}

bool is_found(const LintReport& after, const LintReport& before, LintKind kind,
              const std::vector<LabelId>& structures) {
  const auto has = [&](const LintReport& report) {
    double largest = -1;
    for (const LintFinding& finding : report.findings) {
      if (finding.kind != kind || finding.severity == LintSeverity::kUndetermined) continue;
      const bool names_all = std::ranges::all_of(structures, [&](LabelId id) {
        return std::ranges::find(finding.structures, id) != finding.structures.end();
      });
      if (names_all) largest = std::max(largest, static_cast<double>(finding.voxels));
    }
    return largest;
  };
  return has(after) > has(before);
}

TEST(Planting, ChangesAMapTheSameWayAgain) {
  const LintCase clean = organs_case(1);
  for (const PlantedFault& fault : planted_faults()) {
    LintCase one = clean, other = clean;
    Random random(2), again(2);
    ASSERT_EQ(fault.plant(one, random), fault.plant(other, again)) << fault.name;
    EXPECT_EQ(voxels_of(one).voxels(), voxels_of(other).voxels()) << fault.name;
  }
}

}  // namespace palpate::test
