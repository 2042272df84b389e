// Cost of structure distances in the servo's tick: a knee, and 250 structures of which some are near. See
// README.md.

#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkImplicitPolyDataDistance.h>
#include <vtkNew.h>
#include <vtkPolyData.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <random>

#include "json_file.h"
#include "palpate/contact/distances.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate::bench {
namespace {

constexpr double kReach_mm = 20;
constexpr unsigned kSeed = 61;

std::int64_t now_ns() {
  return std::chrono::steady_clock::now().time_since_epoch().count();
}

struct Costs {
  double median_ns = 0, p99_ns = 0, max_ns = 0;
};
Costs costs_of(std::vector<std::int64_t> ns) {
  std::sort(ns.begin(), ns.end());
  return {static_cast<double>(ns[ns.size() / 2]), static_cast<double>(ns[ns.size() * 99 / 100]),
          static_cast<double>(ns.back())};
}

// queries of a tick, once at every position
void measure(const char* what, const DistanceTrees& distances, const std::vector<Point<Patient>>& positions,
             nlohmann::json& json) {
  const std::vector<ToolPart> point{ToolPart{}};
  std::vector<std::int64_t> ticks;
  std::size_t near = 0;
  double all_ns = 0, sum_mm = 0;
  for (const Point<Patient>& position : positions) {
    const std::int64_t begun = now_ns();
    const auto reported = nearest_structures(distances, point, position);
    ticks.push_back(now_ns() - begun);
    all_ns += static_cast<double>(ticks.back());
    sum_mm += reported[0].distance_mm;
    for (std::size_t s = 0; s < distances.structures().size(); ++s)
      near += distances.lower_bound_mm(s, box_of_tool(point, position)) <= kReach_mm;
  }
  std::size_t bytes = 0, pieces = 0;
  for (const TrackedStructure& structure : distances.structures()) {
    bytes += structure.tree->bytes();
    pieces += structure.tree->pieces();
  }
  const Costs costs = costs_of(ticks);
  const auto count = static_cast<double>(distances.structures().size());
  const double near_each = static_cast<double>(near) / static_cast<double>(positions.size());
  std::printf(
      "%-12s %4.0f structures, %5.1f near: median %7.0f ns, p99 %7.0f, most %7.0f; %5.0f ns a near one; "
      "%.0f pieces and %.2f MB each (%.1f)\n",
      what, count, near_each, costs.median_ns, costs.p99_ns, costs.max_ns,
      all_ns / std::max<double>(1, static_cast<double>(near)), static_cast<double>(pieces) / count,
      static_cast<double>(bytes) / count / (1 << 20), sum_mm / static_cast<double>(positions.size()));
  json[what] = {{"structures", count},
                {"near", near_each},
                {"median_ns", costs.median_ns},
                {"p99_ns", costs.p99_ns},
                {"max_ns", costs.max_ns},
                {"ns_a_near_one", all_ns / std::max<double>(1, static_cast<double>(near))},
                {"bytes_each", static_cast<double>(bytes) / count}};
}

// balls of 4 to 15 mm at random positions in a body, each on a separate grid
DistanceTrees crowd(std::size_t count) {
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> coordinate(-150, 150), radius(4, 15);
  std::vector<TrackedStructure> structures;
  constexpr double kSpacing_mm = 0.8, kEdge_mm = 4;
  for (std::size_t n = 0; n < count; ++n) {
    const double z = coordinate(random), y = coordinate(random), x = coordinate(random), r = radius(random);
    GridGeometry grid;
    const int half = static_cast<int>(std::ceil((r + kEdge_mm) / kSpacing_mm));
    grid.dims = {2 * half + 1, 2 * half + 1, 2 * half + 1};
    grid.spacing_mm.setConstant(kSpacing_mm);
    grid.origin = Point<Patient>(x - half * kSpacing_mm, y - half * kSpacing_mm, z - half * kSpacing_mm);
    Volume<std::int16_t> volume(grid);
    const auto X_PatientVoxel = grid.X_PatientVoxel();
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i) {
          const double mm = (X_PatientVoxel * Point<Voxel>(i, j, k) - Point<Patient>(x, y, z)).norm() - r;
          volume.at(i, j, k) =
              static_cast<std::int16_t>(std::lround(std::clamp(mm, -kEdge_mm, kEdge_mm) / kSurfaceStep_mm));
        }
    const SignedField field(volume,
                            {kSurfaceStep_mm, 0, static_cast<std::int16_t>(kEdge_mm / kSurfaceStep_mm)});
    structures.push_back(
        {static_cast<LabelId>(n + 1),
         std::make_shared<const SurfaceTree>(std::make_shared<const Surface>(field, field, 1)), true});
  }
  return {std::move(structures), kReach_mm};
}

std::vector<Point<Patient>> places_in(const Eigen::Array3d& low, const Eigen::Array3d& high, int count) {
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> part(0, 1);
  std::vector<Point<Patient>> positions;
  for (int n = 0; n < count; ++n) {
    Eigen::Array3d at;
    for (int axis = 0; axis < 3; ++axis) at[axis] = part(random);
    positions.emplace_back(Eigen::Vector3d(low + at * (high - low)));
  }
  return positions;
}

// the same surface as triangles, with VTK's search
void measure_vtk(const SurfaceTree& tree, const std::vector<Point<Patient>>& positions,
                 nlohmann::json& json) {
  const SignedField& position = tree.surface()->distance_field();
  const Volume<float> values = position.values();
  const GridGeometry& grid = values.geometry();
  vtkNew<vtkImageData> image;
  image->SetDimensions(grid.dims[0], grid.dims[1], grid.dims[2]);
  image->SetSpacing(grid.spacing_mm[0], grid.spacing_mm[1], grid.spacing_mm[2]);
  image->SetOrigin(grid.origin[0], grid.origin[1], grid.origin[2]);
  image->AllocateScalars(VTK_FLOAT, 1);
  std::copy(values.voxels().begin(), values.voxels().end(), static_cast<float*>(image->GetScalarPointer()));
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(image);
  edges->SetValue(0, 0);
  edges->Update();
  vtkNew<vtkImplicitPolyDataDistance> distance;
  distance->SetInput(edges->GetOutput());
  std::vector<std::int64_t> ours, theirs;
  std::vector<double> separation_mm;
  for (const Point<Patient>& at_position : positions) {
    std::int64_t begun = now_ns();
    const auto near = tree.nearest(at_position);
    ours.push_back(now_ns() - begun);
    double at[3] = {at_position.x(), at_position.y(), at_position.z()};
    begun = now_ns();
    const double mm = distance->EvaluateFunction(at);
    theirs.push_back(now_ns() - begun);
    separation_mm.push_back(std::abs(std::abs(near->distance_mm) - std::abs(mm)));
  }
  std::sort(separation_mm.begin(), separation_mm.end());
  const Costs a = costs_of(ours), b = costs_of(theirs);
  std::printf(
      "one bone, anywhere: palpate median %.0f ns, p99 %.0f; VTK %.0f, %.0f (%lld triangles); apart by %.3f "
      "mm "
      "in the median, %.3f at p99\n",
      a.median_ns, a.p99_ns, b.median_ns, b.p99_ns,
      static_cast<long long>(edges->GetOutput()->GetNumberOfCells()), separation_mm[separation_mm.size() / 2],
      separation_mm[separation_mm.size() * 99 / 100]);
  json["one_bone"] = {{"palpate_median_ns", a.median_ns},
                      {"palpate_p99_ns", a.p99_ns},
                      {"vtk_median_ns", b.median_ns},
                      {"vtk_p99_ns", b.p99_ns}};
}

int run(double spacing_mm, int count, const std::string& file) {
  nlohmann::json json;
  const DistanceTrees many = crowd(250);
  measure("crowd", many, places_in(Eigen::Array3d::Constant(-150), Eigen::Array3d::Constant(150), count),
          json);

  const auto parameters = parse_phantom("knee-phantom:spacing=" + CLI::detail::to_string(spacing_mm));
  if (!parameters) return 3;
  const auto knee = make_phantom(*parameters);
  if (!knee) return 3;
  std::vector<LabelId> ids;
  for (const Segment& segment : knee->labels.segments) ids.push_back(segment.value);
  auto prepared = prepare_surfaces(*label_bricks(knee->labels.layers.front()), ids, {});
  if (!prepared) return 3;
  std::vector<TrackedStructure> structures;
  Eigen::Array3d low = Eigen::Array3d::Constant(1e9), high = -low;
  const std::int64_t begun = now_ns();
  std::size_t largest = 0;
  for (PreparedSurface& one : *prepared) {
    auto tree = std::make_shared<const SurfaceTree>(std::make_shared<const Surface>(std::move(one.surface)));
    low = low.min(tree->low());
    high = high.max(tree->high());
    structures.push_back({one.label, tree, true});
    if (tree->pieces() > structures[largest].tree->pieces()) largest = structures.size() - 1;
  }
  std::printf("trees of the knee: %.0f ms\n", static_cast<double>(now_ns() - begun) * 1e-6);
  const DistanceTrees distances(std::move(structures), kReach_mm);
  const auto points = places_in(low, high, count);
  measure("knee", distances, points, json);
  measure_vtk(*distances.structures()[largest].tree, points, json);
  return write_json("distance_bench", file, json);
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  CLI::App app("How far a tool is from structures, in the servo's tick");
  double spacing_mm = 0.6;
  int points = 20000;
  std::string json;
  app.add_option("--spacing", spacing_mm, "of the generated knee, mm");
  app.add_option("--places", points, "where the tool is");
  app.add_option("--json", json, "figures, to a file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(spacing_mm, points, json);
}
