#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <optional>

#include "base/test_files.h"
#include "palpate/surfaces/surfaces.h"
#include "palpate/volume_io/volume_io.h"

/// Cartilages and menisci of two real knees as surfaces, with the default setting: no voxel or component is
/// lost, and stored normals agree with the surface also at edges.
namespace palpate {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
// preparing takes most of the time, and cartilages meet no other code
constexpr bool kMenisciAlone = true;
#else
constexpr bool kMenisciAlone = false;
#endif

/// Components of what a predicate holds for, over 26 neighbours.
template <class Inside>
int count_components(const GridGeometry& grid, const Inside& inside) {
  Volume<std::uint8_t> open(grid);
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) open.at(i, j, k) = inside(i, j, k) ? 1 : 0;
    }
  }
  int count = 0;
  std::vector<std::array<int, 3>> next;
  for (std::size_t n = 0; n < open.voxels().size(); ++n) {
    if (open.voxels()[n] == 0) continue;
    ++count;
    const auto row = n / grid.dims[0];
    next.push_back({static_cast<int>(n % grid.dims[0]), static_cast<int>(row % grid.dims[1]),
                    static_cast<int>(row / grid.dims[1])});
    open.voxels()[n] = 0;
    while (!next.empty()) {
      const auto [i, j, k] = next.back();
      next.pop_back();
      for (int m = 0; m < 27; ++m) {
        const int u = i + m % 3 - 1, v = j + m / 3 % 3 - 1, w = k + m / 9 - 1;
        if (open.at_or(u, v, w, 0) == 0) continue;
        open.at(u, v, w) = 0;
        next.push_back({u, v, w});
      }
    }
  }
  return count;
}

struct VoxelRetention {
  std::size_t voxels = 0, outside = 0;
  double deepest = 0;  ///< Greatest distance of a labelled voxel centre outside the surface, in half voxels
                       ///< along the normal
};

VoxelRetention count_retained(const PreparedSurface& s, const Volume<LabelId>& labels) {
  VoxelRetention retention;
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j) {
      for (int i = 0; i < dims[0]; ++i) {
        if (labels.at(i, j, k) != s.label) continue;
        ++retention.voxels;
        const Point<Patient> centre = X_PatientVoxel * Point<Voxel>(i, j, k);
        const double out = s.surface.distance_mm(centre);
        // the centre is a voxel of the position; what is left is rounding of its place
        if (out <= 1e-6) continue;
        ++retention.outside;
        const Eigen::Vector3d n = labels.geometry().direction.transpose() * s.surface.outward(centre).eigen();
        retention.deepest =
            std::max(retention.deepest, out / (0.5 * n.cwiseAbs().dot(labels.geometry().spacing_mm)));
      }
    }
  }
  return retention;
}

/// Angles between the normal and the position's gradient, where the surface crosses the grid, in degrees.
std::vector<double> angles_on_surface(const Surface& surface) {
  const Volume<std::int16_t> position = surface.distance_field().bricks().dense();
  const GridGeometry& grid = position.geometry();
  std::vector<double> angles;
  for (int k = 1; k + 1 < grid.dims[2]; ++k) {
    for (int j = 1; j + 1 < grid.dims[1]; ++j) {
      for (int i = 1; i + 1 < grid.dims[0]; ++i) {
        for (int a = 0; a < 3; ++a) {
          const double here = position.at(i, j, k),
                       next = position.at(i + (a == 0), j + (a == 1), k + (a == 2));
          if ((here < 0) == (next < 0) || (i + 2 * j + 3 * k) % 5 != 0) continue;
          const double t = here / (here - next);
          const Point<Patient> p =
              grid.X_PatientVoxel() * Point<Voxel>(i + (a == 0) * t, j + (a == 1) * t, k + (a == 2) * t);
          const auto g = sample_central_differences(surface.distance_field(), p).gradient.normalized();
          angles.push_back(std::acos(std::clamp(g.dot(surface.outward(p)), -1.0, 1.0)) * 180 / 3.14159265);
        }
      }
    }
  }
  std::sort(angles.begin(), angles.end());
  return angles;
}

void expect_thin_tissue_survives(const std::string& name) {
  PALPATE_SHARED_FILE(file, name);
  const auto read = read_labels(file);
  ASSERT_TRUE(read.ok());
  const Volume<LabelId>& labels = read->labels.layers.front();
  std::vector<LabelId> thin;
  for (const Segment& s : read->labels.segments) {
    const auto named = [&](const char* part) { return s.name.find(part) != std::string::npos; };
    if (named("meniscus") || (!kMenisciAlone && named("cartilage"))) thin.push_back(s.value);
  }
  ASSERT_EQ(thin.size(), kMenisciAlone ? 2u : 6u);
  const auto prepared = prepare_surfaces(*label_bricks(labels), thin, {});
  ASSERT_TRUE(prepared.ok());
  for (const PreparedSurface& s : *prepared) {
    const std::string tissue = read->labels.find(s.label)->name;
    SCOPED_TRACE(tissue);
    const VoxelRetention retention = count_retained(s, labels);
    EXPECT_LE(static_cast<double>(retention.outside), 0.05 * static_cast<double>(retention.voxels));
    EXPECT_LE(retention.deepest, 1);
    const Volume<std::int16_t> position = s.surface.distance_field().bricks().dense();
    const int components =
        count_components(position.geometry(), [&](int i, int j, int k) { return position.at(i, j, k) <= 0; });
    const int labelled = count_components(labels.geometry(),
                                          [&](int i, int j, int k) { return labels.at(i, j, k) == s.label; });
    EXPECT_EQ(components, labelled);
    EXPECT_EQ(s.components, labelled);
    const std::vector<double> angles = angles_on_surface(s.surface);
    const auto percentile = [&](double p) {
      return angles[static_cast<std::size_t>(p * static_cast<double>(angles.size() - 1))];
    };
    const double astray =
        static_cast<double>(angles.end() - std::upper_bound(angles.begin(), angles.end(), 90.0)) /
        static_cast<double>(angles.size());
    EXPECT_LT(percentile(0.9), 40);
    EXPECT_LT(astray, 0.01);
    std::printf(
        "%-26s %7zu voxels, %zu outside, %d components of %d, %zu strays; normal to gradient %4.1f median "
        "%4.1f p90 %4.1f p99 deg, %.4f %% beyond 90; steepest %.2f\n",
        tissue.c_str(), retention.voxels, retention.outside, components, labelled, s.strays.size(),
        percentile(0.5), percentile(0.9), percentile(0.99), 100 * astray, s.surface.max_gradient());
  }
}

TEST(KneeSurfaces, ThinTissueOfTheHandSegmentedKneeSurvives) {
  expect_thin_tissue_survives("knee_spl/seg.nrrd");
}

TEST(KneeSurfaces, ThinTissueOfTheObliqueKneeSurvives) {
  expect_thin_tissue_survives("knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd");
}

}  // namespace
}  // namespace palpate
