// Soft tissue: cost of a cell, a frame, a box and a tick, each interleaved with the plain implementation. See
// README.md.

#include <time.h>

#include <CLI/CLI.hpp>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <vector>

#include "json_file.h"
#include "palpate/contact/proxy.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate::bench {
namespace {

struct Options {
  int rounds = 9;
  std::string json;
};

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// medians of the processor time of several works, interleaved
std::vector<double> medians_s(const std::vector<std::function<void()>>& works, int rounds) {
  std::vector<std::vector<double>> times(works.size());
  for (int round = 0; round < rounds; ++round)
    for (std::size_t n = 0; n < works.size(); ++n) {
      const double begin = thread_seconds();
      works[n]();
      times[n].push_back(thread_seconds() - begin);
    }
  std::vector<double> medians;
  for (std::vector<double>& of_one : times) {
    std::nth_element(of_one.begin(), of_one.begin() + rounds / 2, of_one.end());
    medians.push_back(of_one[static_cast<std::size_t>(rounds / 2)]);
  }
  return medians;
}

ElasticGrid layer_on_bone(const std::array<int, 3>& cells) {
  ElasticBox box;
  box.cells = cells;
  ElasticGrid grid(
      box,
      [](const Point<Patient>& p) {
        return p.z() < 1 ? ElasticMaterial{Matter::kRigid, 0, 0} : ElasticMaterial{Matter::kSoft, 10, 0.45};
      },
      1);
  grid.set_boundary_springs({true, true, true, true, false, false},
                            Point<Patient>(0.5 * cells[0], 0.5 * cells[1], cells[2]));
  return grid;
}

/// Plain implementation: two 24 x 24 matrices per cell, times its moduli.
class DenseCells {
 public:
  explicit DenseCells(const ElasticGrid& grid) : grid_(grid) {
    // for unit moduli and a unit cube, with the strain at its centre; the cost of the hourglass modes is the
    // same
    const auto sign = [](int corner, int axis) { return (corner >> axis & 1) != 0 ? 0.25f : -0.25f; };
    for (int a = 0; a < 8; ++a)
      for (int b = 0; b < 8; ++b)
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j) {
            lambda_(3 * a + i, 3 * b + j) = sign(a, i) * sign(b, j);
            mu_(3 * a + i, 3 * b + j) = sign(a, j) * sign(b, i);
            if (i != j) continue;
            for (int k = 0; k < 3; ++k) mu_(3 * a + i, 3 * b + j) += sign(a, k) * sign(b, k);
          }
  }
  void apply(const ElasticField& u, ElasticField& force) const {
    std::fill(force.values.begin(), force.values.end(), 0.0f);
    const ElasticLayout& layout = grid_.layout();
    for (int k = 0; k < layout.cells[2]; ++k)
      for (int j = 0; j < layout.cells[1]; ++j)
        for (int i = 0; i < layout.cells[0]; ++i) {
          const std::size_t cell = layout.cell(i, j, k);
          Eigen::Matrix<float, 24, 1> local;
          const auto value = [&](int n) {
            const int corner = n / 3;
            return layout.node(i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2 & 1), n % 3);
          };
          for (int n = 0; n < 24; ++n) local[n] = u.values[value(n)];
          const Eigen::Matrix<float, 24, 1> of_cell =
              grid_.mu()[cell] * (mu_ * local) + grid_.lambda()[cell] * (lambda_ * local);
          for (int n = 0; n < 24; ++n) force.values[value(n)] += of_cell[n];
        }
  }

 private:
  const ElasticGrid& grid_;
  Eigen::Matrix<float, 24, 24> mu_, lambda_;
};

nlohmann::json kernel(int rounds) {
  const ElasticGrid grid = layer_on_bone({63, 48, 24});
  ElasticSolver solver(grid);
  const DenseCells dense(grid);
  ElasticField u(solver.layout()), force(solver.layout());
  for (std::size_t n = 0; n < u.values.size(); ++n) u.values[n] = static_cast<float>(n % 7) * 1e-3f;
  const auto times = medians_s({[&] { solver.forces(u, force); }, [&] { dense.apply(u, force); }}, rounds);
  const double cells = 63 * 48 * 24;
  std::printf("K u, a cell            %8.2f ns   dense 24 x 24 %8.2f ns   %.1f times\n",
              1e9 * times[0] / cells, 1e9 * times[1] / cells, times[1] / times[0]);
  return {{"ns_a_cell", 1e9 * times[0] / cells}, {"dense_ns_a_cell", 1e9 * times[1] / cells}};
}

nlohmann::json frames(int rounds) {
  nlohmann::json all = nlohmann::json::array();
  for (const auto& cells : {std::array{31, 24, 16}, std::array{47, 32, 32}, std::array{63, 48, 32},
                            std::array{79, 64, 40}, std::array{95, 80, 40}}) {
    const ElasticGrid grid = layer_on_bone(cells);
    ElasticSolver solver(grid);
    ElasticField unit(solver.layout()), load(solver.layout());
    int frame = 0;
    const auto slide = [&] {
      const PressurePatch patch(grid,
                                Point<Patient>(0.5 * cells[0] + 0.3 * frame++ - 2, 0.5 * cells[1], cells[2]),
                                Vector<Patient>(0, 0, 1), 2);
      std::fill(load.values.begin(), load.values.end(), 0.0f);
      patch.add(1, load);
      solver.solve(load, unit, kSolverSettings.iterations, 0);
    };
    const double frame_s = medians_s({slide}, rounds)[0];
    const auto soft = static_cast<double>(grid.soft_cells());
    std::printf("a frame, %6.0f cells  %8.2f ms   %8.2f ns a cell\n", soft, 1e3 * frame_s,
                1e9 * frame_s / soft);
    all.push_back({{"cells", soft}, {"ms", 1e3 * frame_s}});
  }
  return all;
}

nlohmann::json box(int rounds) {
  GridGeometry grid;
  grid.dims = {96, 96, 96};
  grid.spacing_mm = Eigen::Vector3d::Constant(0.8);
  Volume<LabelId> labels(grid);
  for (std::size_t n = 0; n < labels.voxels().size(); ++n)
    labels.voxels()[n] = static_cast<LabelId>(n / 90000 % 3);
  const auto bricks = label_bricks(labels);
  const ElasticMaterial by_label[] = {{}, {Matter::kSoft, 10, 0.45}, {Matter::kRigid, 0, 0}};
  ElasticBox pressed_box = elastic_box_of(grid, {{8, 8, 8}, {1, 1, 1}}, 1.6);
  pressed_box.cells = {kSolverSettings.cells_along, kSolverSettings.cells_across,
                       kSolverSettings.cells_across};
  const auto times =
      medians_s({[&] { PALPATE_CHECK(ElasticGrid::of_labels(*bricks, by_label, pressed_box).ok()); },
                 [&] {
                   const auto made = ElasticGrid::of_labels(*bricks, by_label, pressed_box);
                   ElasticSolver solver(*made);
                 }},
                rounds);
  std::printf("a box laid anew        %8.2f ms   of which cells from labels %.2f ms\n", 1e3 * times[1],
              1e3 * times[0]);
  return {{"ms", 1e3 * times[1]}, {"cells_ms", 1e3 * times[0]}};
}

// a plane of voxels, for the proxy
Result<std::shared_ptr<const Model>> plane(TissueLaw law) {
  GridGeometry grid;
  grid.dims = {40, 40, 24};
  grid.spacing_mm = Eigen::Vector3d::Ones();
  grid.origin = Point<Patient>(-19.5, -19.5, -15.5);
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 16; ++k)
    for (int j = 1; j < 39; ++j)
      for (int i = 1; i < 39; ++i) labels.at(i, j, k) = 1;
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.segments = {{1, "tissue", {}, 0, 1}};
  Tissue tissue;
  tissue.stiffness_N_per_mm = 0.3;
  tissue.elastic = ElasticConstants{10, 0.45};
  parts.tissues = {tissue};
  parts.tissue_of_label = {-1, 0};
  parts.tissue_law = law;
  auto made = make_model(std::move(parts));
  if (!made) return made.error();
  const ForceMethod proxy = ForceMethod::kProxy;
  return prepared_for(*made, {&proxy, 1});
}

// A corner of three blocks separated by gaps of air, each soft on a hard core; or the same as rigid layers.
Result<std::shared_ptr<const Model>> corner(TissueLaw law) {
  GridGeometry grid;
  grid.dims = {40, 40, 40};
  grid.spacing_mm = Eigen::Vector3d::Ones();
  grid.origin = Point<Patient>(-19.5, -19.5, -19.5);
  Volume<LabelId> labels(grid);
  for (int k = 1; k < 39; ++k)
    for (int j = 1; j < 39; ++j)
      for (int i = 1; i < 39; ++i) {
        // the block is that of the greatest depth below x, y or z = 0
        const int depth[3] = {19 - i, 19 - j, 19 - k};
        int largest = 0;
        for (int axis = 1; axis < 3; ++axis)
          if (depth[axis] > depth[largest]) largest = axis;
        const int next = std::max(depth[(largest + 1) % 3], depth[(largest + 2) % 3]);
        if (depth[largest] < 0 || depth[largest] - next < 2) continue;
        labels.at(i, j, k) = static_cast<LabelId>(2 * largest + (depth[largest] < 4 ? 1 : 2));
      }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.tissue_of_label = {-1};
  Tissue soft, hard;
  soft.stiffness_N_per_mm = 0.3;
  soft.elastic = ElasticConstants{10, 0.45};
  hard.stiffness_N_per_mm = 2;
  parts.tissues = {soft, hard};
  for (int n = 1; n <= 6; ++n) {
    parts.segments.push_back({static_cast<LabelId>(n), "part", {}, 0, static_cast<LabelId>(n)});
    parts.tissue_of_label.push_back(n % 2 == 1 ? 0 : 1);
  }
  parts.tissue_law = law;
  Tool tool;
  tool.radius_mm = 1.5;
  tool.points_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  parts.tools = {tool};
  auto made = make_model(std::move(parts));
  if (!made) return made.error();
  const ForceMethod proxy = ForceMethod::kProxy;
  return prepared_for(*made, {&proxy, 1});
}

/// A tool of four spheres pressed into that corner so deep that each is in contact with, or near, three soft
/// surfaces and three hard ones beneath: 24 pairs of a sphere and a surface.
class CornerTip {
 public:
  explicit CornerTip(const Model& model) : model_(model) {
    parameters_.method = ForceMethod::kProxy;
    parameters_.max_force_N = parameters_.device[0].limits.peak_force_N = 10;
    parameters_.compliance.number = 1;
    parameters_.compliance.local_compliance[0] = {Point<Patient>(0, 0, 0), 14, Vector<Patient>(0.02, 0, 0),
                                                  0.0125, 3};
    run(1000);
  }
  void run(int ticks) {
    points_ = 0;
    for (int n = 0; n < ticks; ++n, ++ticks_) {
      const double in = std::max(-4.5, 8 - 0.02 * ticks_), x = 0.3 * std::sin(3e-3 * ticks_);
      DeviceState device;
      device.tip = model_.X_WorldPatient * Point<Patient>(in + x, in - x, in + 0.5 * x);
      Wrench wrench;
      tick(model_, parameters_, {&device, 1}, 1e-3, state_, {&wrench, 1}, record_);
      for (int layer = 0; layer < kMaxLayers; ++layer)
        points_ += state_.device[0].proxy.layer(layer).contact_count;
    }
  }
  /// Number of contacts in the last run.
  int points() const { return points_; }

 private:
  const Model& model_;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  int ticks_ = 0, points_ = 0;
};

nlohmann::json corners(int rounds) {
  constexpr int kTicks = 4000;
  const auto layers = corner(TissueLaw::kLayers), elastic = corner(TissueLaw::kElastic);
  PALPATE_CHECK(layers.ok() && elastic.ok());
  CornerTip spring(**layers), deformable(**elastic);
  const auto times = medians_s({[&] { spring.run(kTicks); }, [&] { deformable.run(kTicks); }}, rounds);
  const double points = static_cast<double>(deformable.points()) / kTicks;
  std::printf("a tick of four spheres %8.2f us   with springs %.2f us   in a corner, in %.1f places\n",
              1e6 * times[1] / kTicks, 1e6 * times[0] / kTicks, points);
  return {
      {"yielding_us", 1e6 * times[1] / kTicks}, {"spring_us", 1e6 * times[0] / kTicks}, {"places", points}};
}

nlohmann::json ticks(int rounds) {
  constexpr int kTicks = 20'000;
  const auto spring = plane(TissueLaw::kLayers), deformable = plane(TissueLaw::kElastic);
  PALPATE_CHECK(spring.ok() && deformable.ok());
  ComplianceFrame frame;
  frame.number = 1;
  frame.local_compliance[0] = {Point<Patient>(0, 0, 0), 14, Vector<Patient>(0.02, 0, 0), 0.0125, 3};
  ComplianceFrame finite = frame;
  finite.local_compliance[0].reference_force_N = 0.15;
  finite.local_compliance[0].stiffening_mm_per_N2 = 2;
  finite.local_compliance[0].stiffening_gradient = Vector<Patient>(1, 0, 0);
  const ToolPart part{{}, 3};
  // four lying shafts with six contacts each
  std::vector<ToolPart> shafts;
  for (int n = 0; n < 4; ++n) shafts.push_back({{0, 2.5 * n, 0}, 1, {5, 0, 0}});
  const auto slide = [&](const Model& model, const ComplianceFrame* compliance,
                         std::span<const ToolPart> tool) {
    ProxyState state;
    for (int n = 0; n < kTicks; ++n) {
      const double down = std::max(0.0, 4 - 0.01 * n);
      const Point<Patient> tip(6 * std::sin(1e-3 * n), 6 * std::cos(1e-3 * n), tool[0].radius_mm - 2 + down);
      advance_proxy(model.surfaces, tool, tip, state, {.compliance = compliance});
    }
  };
  const auto times =
      medians_s({[&] {
                   slide(**spring, nullptr, {&part, 1});
                 },
                 [&] {
                   slide(**deformable, &frame, {&part, 1});
                 },
                 [&] {
                   slide(**deformable, &finite, {&part, 1});
                 },
                 [&] { slide(**spring, nullptr, shafts); }, [&] { slide(**deformable, &frame, shafts); }},
                rounds);
  std::printf("a sphere's contact    %8.1f ns   with a spring %.1f ns   %+.1f ns\n", 1e9 * times[1] / kTicks,
              1e9 * times[0] / kTicks, 1e9 * (times[1] - times[0]) / kTicks);
  std::printf("  neo-Hookean          %8.1f ns                           %+.1f ns\n", 1e9 * times[2] / kTicks,
              1e9 * (times[2] - times[0]) / kTicks);
  std::printf("  of 24 places         %8.1f ns   with a spring %.1f ns   %+.1f ns\n", 1e9 * times[4] / kTicks,
              1e9 * times[3] / kTicks, 1e9 * (times[4] - times[3]) / kTicks);
  return {{"yielding_ns", 1e9 * times[1] / kTicks},
          {"shafts_ns", 1e9 * times[4] / kTicks},
          {"shafts_spring_ns", 1e9 * times[3] / kTicks},
          {"spring_ns", 1e9 * times[0] / kTicks},
          {"neo_hookean_ns", 1e9 * times[2] / kTicks}};
}

}  // namespace
}  // namespace palpate::bench

int main(int count, char** arguments) {
  using namespace palpate::bench;
  Options options;
  CLI::App app("Soft tissue that yields: a cell, a frame, a box, a tick");
  app.add_option("--rounds", options.rounds, "medians are of so many")->check(CLI::Range(1, 1000));
  app.add_option("--json", options.json, "write the figures here");
  CLI11_PARSE(app, count, arguments);
  nlohmann::json figures;
  figures["kernel"] = kernel(options.rounds);
  figures["frames"] = frames(options.rounds);
  figures["box"] = box(options.rounds);
  figures["tick"] = ticks(options.rounds);
  figures["corner"] = corners(options.rounds);
  return write_json("tissue_bench", options.json, figures);
}
