#include "volume_io/mesh/mesh_labels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "base/test_seed.h"
#include "volume_io/mesh/mesh_placement.h"
#include "volume_io/mesh/test_meshes.h"

namespace palpate::volume_io {
namespace {

using test_meshes::Vector3;

Eigen::Matrix3d turn_of(double degrees, const Vector3& axis) {
  return Eigen::AngleAxisd(degrees * std::numbers::pi / 180, axis.normalized()).toRotationMatrix();
}

GridGeometry oblique_grid(const std::array<int, 3>& dims, const Vector3& spacing_mm, bool left_handed) {
  GridGeometry grid;
  grid.dims = dims;
  grid.spacing_mm = spacing_mm;
  grid.direction = turn_of(31, {3, -1, 2});
  if (left_handed) grid.direction.col(1) *= -1;
  const Vector3 centre = 0.5 * spacing_mm.cwiseProduct(Vector3(dims[0] - 1, dims[1] - 1, dims[2] - 1));
  grid.origin = Point<Patient>(Vector3(Vector3(4, -7, 11) - grid.direction * centre));
  return grid;
}

std::vector<char> mask_of_mesh(const TriangleMesh& mesh, const GridGeometry& grid) {
  const VoxelRuns voxels = voxels_of_mesh(closed_mesh(mesh), grid, [] { return true; });
  std::vector<char> mask(grid.voxel_count());
  const std::size_t slice = static_cast<std::size_t>(grid.dims[0]) * static_cast<std::size_t>(grid.dims[1]);
  std::uint64_t count = 0;
  for (int k = 0; k < grid.dims[2]; ++k)
    voxels.read_slice(k, [&](std::size_t v) {
      EXPECT_EQ(mask[static_cast<std::size_t>(k) * slice + v], 0) << "once";
      mask[static_cast<std::size_t>(k) * slice + v] = 1;
      ++count;
    });
  EXPECT_EQ(count, voxels.count());
  return mask;
}

void for_each_centre(const GridGeometry& grid,
                     const std::function<void(std::size_t, const Vector3&)>& visit) {
  const auto X = grid.X_PatientVoxel();
  std::size_t n = 0;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) visit(n++, (X * Point<Voxel>(i, j, k)).eigen());
}

struct Agreement {
  double dice = 0, volume = 0, centroid_voxels = 0;  // volume: relative to the shape's
};

Agreement agreement(const TriangleMesh& mesh, const std::function<bool(const Vector3&)>& inside,
                    const GridGeometry& grid) {
  const auto mask = mask_of_mesh(mesh, grid);
  double ours = 0, shapes = 0, both = 0;
  Vector3 our_sum = Vector3::Zero(), shapes_sum = Vector3::Zero();
  for_each_centre(grid, [&](std::size_t n, const Vector3& centre) {
    const bool in = inside(centre);
    ours += mask[n];
    shapes += in;
    both += mask[n] && in;
    if (mask[n]) our_sum += centre;
    if (in) shapes_sum += centre;
  });
  return {2 * both / (ours + shapes), ours / shapes - 1,
          (our_sum / ours - shapes_sum / shapes).norm() / grid.min_spacing_mm()};
}

TEST(WindingNumber, IsWholeWhereItIsClosed) {
  const TriangleMesh torus = test_meshes::torus_mesh(20, 7, 48);
  EXPECT_NEAR(winding_number(torus.points, torus.triangles, {20, 0, 0}), 1, 1e-9);
  EXPECT_NEAR(winding_number(torus.points, torus.triangles, {0, 0, 0}), 0, 1e-9);
  EXPECT_NEAR(winding_number(torus.points, torus.triangles, {300, 0, 0}), 0, 1e-9);
}

// random triangles, and points near, far and on the boundary of the mesh
TEST(WindingNumber, TheFastOneIsTheSumOfSolidAngles) {
  std::mt19937 random(test::test_seed());
  std::normal_distribution<double> normal;
  const auto anywhere = [&](double size) {
    return Vector3(size * Vector3(normal(random), normal(random), normal(random)));
  };
  TriangleMesh soup;
  for (std::uint32_t n = 0; n < 3000; ++n) {
    const Vector3 position = anywhere(20);
    for (int corner = 0; corner < 3; ++corner) soup.points.push_back(position + anywhere(2));
    soup.triangles.push_back({3 * n, 3 * n + 1, 3 * n + 2});
  }
  TriangleMesh bowl = test_meshes::sphere_mesh(25, 80);
  std::erase_if(bowl.triangles, [&](const auto& t) { return bowl.points[t[0]].z() > 5; });
  for (const TriangleMesh* mesh : {&soup, &bowl}) {
    const FastWinding fast(mesh->points, mesh->triangles);
    double max_off = 0;
    for (int n = 0; n < 2000; ++n) {
      const Vector3 from = anywhere(n % 2 ? 15 : 60);
      const double slow = winding_number(mesh->points, mesh->triangles, from), quick = fast.at(from);
      max_off = std::max(max_off, std::abs(slow - quick));
      const double bound = fast.bound_within(from, 2, 1e9);
      EXPECT_GE(bound, std::abs(slow) - 1e-9);
    }
    RecordProperty("max_off", std::to_string(max_off));
    std::printf("[ off by at most %.5f ]\n", max_off);
    EXPECT_LT(max_off, 0.005);
  }
  EXPECT_EQ(FastWinding({}, {}).at({1, 2, 3}), 0);
}

// compared with the sum of solid angles at every centre: closed, open, self-intersecting, duplicated and
// inside-out meshes, on left- and right-handed grids
TEST(MeshLabels, AreWhereTheSurfaceWindsAroundTheCentre) {
  std::mt19937 random(test::test_seed() + 1);
  std::uniform_real_distribution<double> any(-1, 1);
  std::size_t voxels = 0, near_half = 0;
  for (int n = 0; n < 12; ++n) {
    TriangleMesh mesh = n % 3 == 0   ? test_meshes::sphere_mesh(11, 20)
                        : n % 3 == 1 ? test_meshes::torus_mesh(9, 4, 18)
                                     : test_meshes::box_mesh({6, 9, 3});
    mesh = test_meshes::moved(mesh, turn_of(180 * any(random), {any(random), any(random), 1}),
                              Vector3(4, -7, 11) + Vector3(any(random), any(random), any(random)));
    // self-intersecting
    if (n % 4 == 1 || n % 4 == 2) {
      const auto other =
          test_meshes::moved(test_meshes::sphere_mesh(8, 14), turn_of(10, {1, 0, 0}), {9, -5, 12});
      const auto first = static_cast<std::uint32_t>(mesh.points.size());
      mesh.points.insert(mesh.points.end(), other.points.begin(), other.points.end());
      for (const auto& [a, b, c] : other.triangles)
        mesh.triangles.push_back({first + a, first + b, first + c});
    }
    // with holes
    if (n % 4 >= 2) std::erase_if(mesh.triangles, [&](const auto&) { return random() % 10 == 0; });
    if (n % 5 == 4)
      for (auto& triangle : mesh.triangles) std::swap(triangle[0], triangle[1]);
    const GridGeometry grid = oblique_grid({26, 24, 22}, {1.1, 0.9, 1.3}, n % 2 == 0);
    const auto mask = mask_of_mesh(mesh, grid);
    for_each_centre(grid, [&](std::size_t v, const Vector3& centre) {
      const double wound = std::abs(winding_number(mesh.points, mesh.triangles, centre));
      ++voxels;
      // within the error of the fast method around 1/2; voxels outside the bounding box are outside
      if (std::abs(wound - 0.5) < 0.01)
        ++near_half;
      else
        EXPECT_EQ(mask[v] != 0, wound > 0.5) << "mesh " << n << ", " << centre.transpose() << ": " << wound;
    });
  }
  EXPECT_LT(near_half, voxels / 50);
}

TEST(MeshLabels, AShapeIsTheShape) {
  const Eigen::Matrix3d turn = turn_of(53, {1, 1, -2});
  const Vector3 at(5, -6, 10);
  const auto local = [&](const Vector3& point) { return Vector3(turn.transpose() * (point - at)); };
  struct Shape {
    const char* name;
    TriangleMesh mesh;
    std::function<bool(const Vector3&)> inside;
  };
  const Shape shapes[] = {
      {"sphere", test_meshes::sphere_mesh(24, 200), [&](const Vector3& p) { return local(p).norm() <= 24; }},
      {"torus", test_meshes::torus_mesh(19, 9, 200),
       [&](const Vector3& p) {
         const Vector3 q = local(p);
         return std::hypot(std::hypot(q.x(), q.y()) - 19, q.z()) <= 9;
       }},
      {"plate", test_meshes::box_mesh({20, 17, 5}),
       [&](const Vector3& p) { return (local(p).cwiseAbs().array() <= Vector3(20, 17, 5).array()).all(); }}};
  for (const Shape& shape : shapes)
    for (const bool left_handed : {false, true}) {
      const GridGeometry grid = oblique_grid({66, 66, 42}, {1, 1, 1.6}, left_handed);
      const Agreement result = agreement(test_meshes::moved(shape.mesh, turn, at), shape.inside, grid);
      std::printf("[ %s: Dice %.4f, volume %+.2f %%, centre %.3f voxel ]\n", shape.name, result.dice,
                  100 * result.volume, result.centroid_voxels);
      EXPECT_GE(result.dice, 0.98) << shape.name;
      EXPECT_LE(std::abs(result.volume), 0.01) << shape.name;
      EXPECT_LE(result.centroid_voxels, 0.1) << shape.name;
    }
}

TEST(MeshLabels, AHoleChangesLittle) {
  TriangleMesh sphere = test_meshes::sphere_mesh(24, 120);
  const std::size_t all = sphere.triangles.size();
  // a tenth is missing on one side
  std::erase_if(sphere.triangles, [&](const auto& t) { return sphere.points[t[0]].x() > 18; });
  ASSERT_LT(sphere.triangles.size(), all * 95 / 100);
  const GridGeometry grid = oblique_grid({60, 60, 60}, {1, 1, 1}, false);
  const Vector3 at(4, -7, 11);
  const ClosedMesh closed = closed_mesh(test_meshes::moved(sphere, Eigen::Matrix3d::Identity(), at));
  EXPECT_EQ(closed.loops, 1u);
  const auto received = agreement(
      test_meshes::moved(sphere, Eigen::Matrix3d::Identity(), at),
      [&](const Vector3& p) { return (p - at).norm() <= 24; }, grid);
  EXPECT_GE(received.dice, 0.95);
}

// each row is reported, however long a slice takes
TEST(MeshLabels, EachRowIsASignOfLife) {
  GridGeometry grid;
  grid.dims = {12, 12, 12};
  const ClosedMesh box = closed_mesh(
      test_meshes::moved(test_meshes::box_mesh({4, 4, 4}), Eigen::Matrix3d::Identity(), {5.5, 5.5, 5.5}));
  int appearances = 0;
  const auto whole = voxels_of_mesh(box, grid, [&] { return ++appearances > 0; });
  EXPECT_EQ(whole.count(), 8u * 8 * 8);
  EXPECT_GE(appearances, 64);
  const int half = appearances / 2;
  appearances = 0;
  EXPECT_LT(voxels_of_mesh(box, grid, [&] { return ++appearances < half; }).count(), whole.count());
  EXPECT_EQ(appearances, half);
}

// adjacent meshes share no voxel and leave no gap
TEST(MeshLabels, AWallBelongsToOneOfTwo) {
  GridGeometry grid;
  grid.dims = {12, 12, 12};
  const auto low = mask_of_mesh(
      test_meshes::moved(test_meshes::box_mesh({2, 4, 4}), Eigen::Matrix3d::Identity(), {3, 5, 5}), grid);
  const auto high = mask_of_mesh(
      test_meshes::moved(test_meshes::box_mesh({2, 4, 4}), Eigen::Matrix3d::Identity(), {7, 5, 5}), grid);
  std::size_t in = 0;
  for (std::size_t n = 0; n < low.size(); ++n) {
    EXPECT_FALSE(low[n] && high[n]);
    in += static_cast<std::size_t>(low[n] + high[n]);
  }
  EXPECT_EQ(in, 8u * 8 * 8);
}

TEST(MeshLabels, BeyondTheGridIsCutOffAndOutsideIsNothing) {
  GridGeometry grid;
  grid.dims = {10, 10, 10};
  const auto whole = mask_of_mesh(test_meshes::box_mesh({100, 100, 100}), grid);
  EXPECT_EQ(std::count(whole.begin(), whole.end(), 1), 1000);
  const auto none = mask_of_mesh(
      test_meshes::moved(test_meshes::box_mesh({1, 1, 1}), Eigen::Matrix3d::Identity(), {50, 0, 0}), grid);
  EXPECT_EQ(std::count(none.begin(), none.end(), 1), 0);
}

// ---- placing --------------------------------------------------------------------------------------------

GridGeometry scan_beside_the_origin() {
  GridGeometry grid;
  grid.dims = {80, 80, 40};
  grid.origin = Point<Patient>(-130, 20, -30);
  return grid;
}

Result<TransformedMeshes> placed(const TriangleMesh& mesh, const GridGeometry* scan,
                                 const MeshPlacementOptions& placement_options = {},
                                 std::optional<MeshSpace> declared = {}) {
  MeshSurvey survey(scan, placement_options.unit_mm);
  survey.observe(mesh);
  return transform_meshes(survey, placement_options, declared);
}

TEST(MeshPlacementOptions, InfersSpaceAndUnitFromTheScan) {
  const GridGeometry scan = scan_beside_the_origin();
  const TriangleMesh in_mm =
      test_meshes::moved(test_meshes::sphere_mesh(12, 20), Eigen::Matrix3d::Identity(), {-90, 60, -10});
  for (const MeshSpace space : {MeshSpace::kLps, MeshSpace::kRas})
    for (const double unit_mm : kMeshUnits_mm) {
      TriangleMesh mesh = in_mm;
      for (Vector3& point : mesh.points) point = in_patient(point, space, 1) / unit_mm;
      const auto found = placed(mesh, &scan);
      ASSERT_TRUE(found) << found.error().message();
      EXPECT_EQ(found->space, space);
      EXPECT_EQ(found->unit_mm, unit_mm);
      EXPECT_TRUE(found->space_is_known);
      EXPECT_NE(found->note.find("100 % of its points lie in the scan"), std::string::npos) << found->note;
    }
}

// a scan around the origin also contains a mesh read in too small a unit
TEST(MeshPlacementOptions, SeveralUnitsThatFitAreAskedFor) {
  GridGeometry scan;
  scan.dims = {300, 300, 300};
  scan.origin = Point<Patient>(-150, -150, -150);
  TriangleMesh leg = test_meshes::sphere_mesh(0.12, 20);
  const auto requested_for = placed(leg, &scan, {}, MeshSpace::kLps);
  ASSERT_FALSE(requested_for);
  EXPECT_NE(requested_for.error().message().find("read in cm and in m alike"), std::string::npos)
      << requested_for.error().message();
  EXPECT_NE(requested_for.error().message().find("--mesh-unit"), std::string::npos);
  EXPECT_EQ(placed(leg, &scan, {{}, 1000}, MeshSpace::kLps)->unit_mm, 1000);
  // any unit if it is given: inches
  const GridGeometry beside = scan_beside_the_origin();
  TriangleMesh inches =
      test_meshes::moved(test_meshes::sphere_mesh(12, 20), Eigen::Matrix3d::Identity(), {-90, 60, -10});
  for (Vector3& point : inches.points) point /= 25.4;
  const auto found = placed(inches, &beside, {{}, 25.4});
  ASSERT_TRUE(found) << found.error().message();
  EXPECT_EQ(found->unit_mm, 25.4);
  EXPECT_EQ(found->space, MeshSpace::kLps);
}

TEST(MeshPlacementOptions, AmbiguousPlacementIsAnError) {
  GridGeometry scan = scan_beside_the_origin();
  scan.origin = Point<Patient>(-40, -40, -20);
  const TriangleMesh middle = test_meshes::sphere_mesh(12, 20);
  const auto requested_for = placed(middle, &scan);
  ASSERT_FALSE(requested_for);
  EXPECT_NE(requested_for.error().message().find("--mesh-space"), std::string::npos);
  const auto reported = placed(middle, &scan, {MeshSpace::kRas, {}});
  ASSERT_TRUE(reported);
  EXPECT_EQ(reported->space, MeshSpace::kRas);
  EXPECT_EQ(placed(middle, &scan, {}, MeshSpace::kLps)->space, MeshSpace::kLps);
  // the user's choice takes precedence over the file's statement
  EXPECT_EQ(placed(middle, &scan, {MeshSpace::kRas, {}}, MeshSpace::kLps)->space, MeshSpace::kRas);
  const auto elsewhere =
      placed(test_meshes::moved(middle, Eigen::Matrix3d::Identity(), {500, 300, 900}), &scan);
  ASSERT_FALSE(elsewhere);
  EXPECT_NE(elsewhere.error().what.find("does not lie in the scan"), std::string::npos);
  const auto alone = placed(middle, nullptr);
  ASSERT_TRUE(alone);
  EXPECT_FALSE(alone->space_is_known);
}

}  // namespace
}  // namespace palpate::volume_io
