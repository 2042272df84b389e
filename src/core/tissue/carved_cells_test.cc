#include "palpate/tissue/carved_cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <random>
#include <string>

#include "base/test_seed.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/tissue_settings.h"

namespace palpate {
namespace {

// number of steps until a full cell that was removed has reached its target
const int kStepsToFollow = static_cast<int>(std::ceil(1 / kSolverSettings.max_fill_change)) + 2;
constexpr LabelId kSoftLabel = 1, kFirmLabel = 2, kBoneLabel = 3, kProtectedLabel = 4;

// A layer of two tissues on bone, with a protected cord; voxels of 1 x 0.9 x 1.1 mm, air above z = 12.
std::shared_ptr<const Model> layered(const Eigen::Matrix3d& direction = Eigen::Matrix3d::Identity()) {
  auto model = std::make_shared<Model>();
  model->tissue_law = TissueLaw::kElastic;
  GridGeometry grid;
  grid.dims = {36, 34, 26};
  grid.spacing_mm = {1, 0.9, 1.1};
  grid.origin = Point<Patient>(-17, -15, -12);
  grid.direction = direction;
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        LabelId& label = labels.at(i, j, k);
        if (k < 5)
          label = kBoneLabel;
        else if (k < 22)
          label = i < 20 ? kSoftLabel : kFirmLabel;
        if (std::hypot(j - 25, k - 12) < 2) label = kProtectedLabel;
      }
  model->labels = label_bricks(labels);
  Tissue soft, firm, bone, kept;
  soft.elastic = ElasticConstants{10, 0.45};
  firm.elastic = ElasticConstants{40, 0.3};
  kept.elastic = ElasticConstants{20, 0.45};
  kept.protection = Protection::kBlock;
  model->tissues = {soft, firm, bone, kept};
  model->tissue_of_label = {-1, 0, 1, 2, 3};
  return model;
}

const std::vector<ElasticMaterial> kMaterials{
    {}, {Matter::kSoft, 10, 0.45}, {Matter::kSoft, 40, 0.3}, {Matter::kRigid}, {Matter::kSoft, 20, 0.45}};

ElasticBox box_in(const Model& model, const std::array<int, 3>& first, const std::array<int, 3>& cells) {
  ElasticBox box = elastic_box_of(model.labels->geometry(), {{0, 0, 0}, {1, 1, 1}}, 1.5);
  box.corner = box.patient(Eigen::Vector3d(first[0], first[1], first[2]) * box.cell_mm);
  box.cells = cells;
  return box;
}

void expect_same_bits(const ElasticValues& a, const ElasticValues& b, const char* what) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0) << what;
}

void expect_same(const ElasticGrid& grid, const ElasticGrid& whole) {
  expect_same_bits(grid.mu(), whole.mu(), "mu");
  expect_same_bits(grid.lambda(), whole.lambda(), "lambda");
  expect_same_bits(grid.fill(), whole.fill(), "fill");
  expect_same_bits(grid.springs(), whole.springs(), "springs");
  EXPECT_EQ(grid.constraints(), whole.constraints());
}

// sweep given in the grid's own axes
Cut sweep_in(const Model& model, const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_mm,
             std::uint32_t stroke = 0) {
  const auto X_PatientVoxel = model.labels->geometry().X_PatientVoxel();
  return {0, {X_PatientVoxel * Point<Voxel>(from), X_PatientVoxel * Point<Voxel>(to), radius_mm, stroke}};
}

std::shared_ptr<const Model> cut(const std::shared_ptr<const Model>& model, const std::vector<Cut>& cuts) {
  const auto carving = model->carving != nullptr ? model->carving : std::make_shared<const Carving>(*model);
  return carving->with(cuts)->applied_to(*model);
}

TEST(RemovedFractions, EqualTheSweptFractionOfAVoxel) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  std::uniform_real_distribution<double> middle(6, 20), radius(1.5, 4);
  const auto model = layered();
  const auto X_PatientVoxel = model->labels->geometry().X_PatientVoxel();
  double worst = 0;
  for (int n = 0; n < 6; ++n) {
    const Eigen::Vector3d from(middle(random), middle(random), middle(random));
    const Cut one = sweep_in(*model, from, from + Eigen::Vector3d(2, 1, 0.5), radius(random));
    const auto used = cut(model, {one})->carving->removed_fraction();
    ASSERT_NE(used, nullptr);
    const SweptShape shape(one.sweep);
    double sum = 0, truth_sum = 0;
    for (int k = 0; k < 26; ++k)
      for (int j = 0; j < 34; ++j)
        for (int i = 0; i < 36; ++i) {
          const LabelId label = model->labels->at(i, j, k);
          constexpr int kSamples = 5;
          int within = 0;
          for (int p = 0; p < kSamples * kSamples * kSamples; ++p) {
            const auto along = [](int voxel, int index) { return voxel + (index + 0.5) / kSamples - 0.5; };
            const Point<Voxel> at(along(i, p % kSamples), along(j, p / kSamples % kSamples),
                                  along(k, p / (kSamples * kSamples)));
            within += shape.depth_mm(X_PatientVoxel * at) > 0;
          }
          const bool stays = label == 0 || label == kProtectedLabel;
          const double truth = stays ? 0 : within / 125.0, part = used->at(i, j, k) / 255.0;
          worst = std::max(worst, std::abs(part - truth));
          sum += part;
          truth_sum += truth;
        }
    EXPECT_NEAR(sum / truth_sum, 1, 0.02);
  }
  EXPECT_LT(worst, 0.15);
}

TEST(RemovedFractions, AreNotRecordedForRigidTissue) {
  auto stiff = std::make_shared<Model>(*layered());
  stiff->tissue_law = TissueLaw::kLayers;
  const auto cut_off = cut(stiff, {sweep_in(*stiff, {12, 12, 20}, {14, 12, 20}, 2)});
  EXPECT_NE(cut_off->labels, stiff->labels);
  EXPECT_EQ(cut_off->carving->removed_fraction(), nullptr);
}

TEST(ChangedVoxels, BoundTheDifferingVoxels) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  GridGeometry grid;
  grid.dims = {40, 35, 50};
  const Bricks<std::uint8_t> none(grid, std::uint8_t{0});
  const auto within = [&](int largest) {
    return static_cast<int>(random() % static_cast<unsigned>(largest));
  };
  for (int round = 0; round < 200; ++round) {
    PatchOf<std::uint8_t> patch{
        {{within(30), within(25), within(40)}, {1 + within(9), 1 + within(9), 1 + within(9)}}, {}};
    for (std::size_t n = 0; n < patch.box.voxel_count(); ++n)
      patch.values.push_back(static_cast<std::uint8_t>(random() % 2));
    const Bricks<std::uint8_t> now = none.with(patch);
    const VoxelBox region{{within(20), within(20), within(20)},
                          {1 + within(20), 1 + within(15), 1 + within(30)}};
    std::array<int, 3> low{99, 99, 99}, high{-1, -1, -1};
    for (int k = region.first[2]; k < region.first[2] + region.size[2]; ++k)
      for (int j = region.first[1]; j < region.first[1] + region.size[1]; ++j)
        for (int i = region.first[0]; i < region.first[0] + region.size[0]; ++i)
          if (now.at(i, j, k) != 0) {
            low = {std::min(low[0], i), std::min(low[1], j), std::min(low[2], k)};
            high = {std::max(high[0], i + 1), std::max(high[1], j + 1), std::max(high[2], k + 1)};
          }
    VoxelBox expected;
    if (high[0] > 0) expected = {low, {high[0] - low[0], high[1] - low[1], high[2] - low[2]}};
    EXPECT_EQ(changed_voxels(&none, &now, region), expected);
    EXPECT_EQ(changed_voxels(nullptr, &now, region), expected);
    EXPECT_EQ(changed_voxels(&now, nullptr, region), expected);
    EXPECT_EQ(changed_voxels(&now, &now, region), VoxelBox());
  }
}

/// Cells and a solver that follow changes, compared with new ones for the same model.
class CarvedCellsTest : public ::testing::Test {
 protected:
  void begin(const std::shared_ptr<const Model>& model, const ElasticBox& box) {
    box_ = box;
    about_ = box.patient(0.5 * box.cell_mm * Eigen::Vector3d(box.cells[0], box.cells[1], box.cells[2]));
    model_ = model;
    cells_.emplace(carved_labels(*model), kMaterials, box, about_);
    solver_.emplace(cells_->grid());
  }
  void step() {
    before_ = cells_->grid();
    cells_->follow(carved_labels(*model_), *solver_);
    const ElasticGrid& grid = cells_->grid();
    for (std::size_t n = 0; n < grid.fill().size(); ++n) {
      if (grid.mu()[n] == 0 || before_->mu()[n] == 0) continue;
      ASSERT_LE(std::abs(grid.fill()[n] - before_->fill()[n]), kSolverSettings.max_fill_change + 1e-6);
    }
  }
  void settle() {
    for (int n = 0; n < kStepsToFollow; ++n) step();
    EXPECT_TRUE(cells_->changing_cells().empty());
  }
  void expect_as_whole() {
    const CarvedCells whole(carved_labels(*model_), kMaterials, box_, about_);
    expect_same(cells_->grid(), whole.grid());
    ElasticSolver fresh(whole.grid());
    std::mt19937 random(1);
    std::uniform_real_distribution<float> small(-1, 1);
    const ElasticLayout& layout = whole.grid().layout();
    ElasticField u(layout), f(layout), g(layout);
    for (int k = 0; k <= layout.cells[2]; ++k)
      for (int j = 0; j <= layout.cells[1]; ++j)
        for (int i = 0; i <= layout.cells[0]; ++i)
          for (int c = 0; c < 3; ++c) u.values[layout.node(i, j, k, c)] = small(random);
    ElasticField at_rest = u, fresh_at_rest = u;
    solver_->zero_constrained(at_rest);
    fresh.zero_constrained(fresh_at_rest);
    expect_same_bits(at_rest.values, fresh_at_rest.values, "held");
    solver_->forces(u, f);
    fresh.forces(u, g);
    expect_same_bits(f.values, g.values, "forces");
  }
  // compliance under a patch at the surface, solved from scratch
  double compliance(const CarvedCells& cells, ElasticSolver& solver, const Point<Patient>& at,
                    ElasticSolution& solution) const {
    const PressurePatch patch(cells.grid(), at, Vector<Patient>(box_.axes.col(2)), 3);
    ElasticField load(cells.grid().layout()), u(cells.grid().layout());
    patch.add(1, load);
    solution = solver.solve(load, u, 200, 1e-6);
    return patch.displacement_mm(u);
  }

  std::shared_ptr<const Model> model_;
  ElasticBox box_;
  Point<Patient> about_;
  std::optional<CarvedCells> cells_;
  std::optional<ElasticSolver> solver_;
  std::optional<ElasticGrid> before_;
};

TEST_F(CarvedCellsTest, IncrementalUpdatesEqualARebuild) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  std::uniform_real_distribution<double> x(-2, 38), y(-2, 36), z(2, 24), path(-6, 6), radius(1, 4);
  constexpr int kScenes = 4, kActions = 8;
  for (int scene = 0; scene < kScenes; ++scene) {
    const Eigen::Matrix3d turned =
        Eigen::AngleAxisd(0.4 * scene, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
    const auto from = [&](int largest) {
      return static_cast<int>(random() % static_cast<unsigned>(largest)) - 3;
    };
    const auto model = layered(turned);
    begin(model, box_in(*model, {from(8), from(8), from(6)}, {19, 16, 18}));
    for (int n = 0; n < kActions; ++n) {
      const auto carving = model_->carving;
      if (const unsigned dice = random() % 4; dice == 0 && carving && carving->strokes_to_undo() > 0)
        model_ = carving->undone()->applied_to(*model_);
      else if (dice == 1 && carving && carving->strokes_to_redo() > 0)
        model_ = carving->redone()->applied_to(*model_);
      else {
        const Eigen::Vector3d begin_at(x(random), y(random), z(random));
        model_ = cut(model_, {sweep_in(*model_, begin_at,
                                       begin_at + Eigen::Vector3d(path(random), path(random), path(random)),
                                       radius(random), static_cast<std::uint32_t>(n + 1))});
      }
      // some are cut further before they have reached their target
      if (random() % 2 == 0)
        step();
      else {
        settle();
        expect_as_whole();
      }
      if (HasFailure()) return;
    }
    settle();
    expect_as_whole();
  }
}

TEST_F(CarvedCellsTest, SolutionEqualsThatOfRebuiltCells) {
  const auto model = layered();
  begin(model, box_in(*model, {2, 1, 0}, {19, 16, 18}));
  const Point<Patient> beside = model->labels->geometry().X_PatientVoxel() * Point<Voxel>(11, 11, 21.5);
  // a groove down to the bone and into it
  for (int n = 0; n < 12; ++n) {
    const double deep = 21 - 1.5 * n;
    model_ = cut(model_, {sweep_in(*model_, {17, 3, deep}, {17, 24, deep}, 2)});
    step();
  }
  settle();
  const CarvedCells whole(carved_labels(*model_), kMaterials, box_, about_);
  ElasticSolver fresh(whole.grid());
  ElasticSolution followed, laid;
  const double w = compliance(*cells_, *solver_, beside, followed),
               truth = compliance(whole, fresh, beside, laid);
  EXPECT_TRUE(followed.converged && laid.converged);
  EXPECT_GT(truth, 0);
  EXPECT_NEAR(w / truth, 1, 1e-5);
  EXPECT_LE(followed.iterations, laid.iterations + laid.iterations / 4 + 1);
  RecordProperty("iterations", followed.iterations);
}

TEST_F(CarvedCellsTest, RemovedBoneReleasesItsNodes) {
  const auto model = layered();
  begin(model, box_in(*model, {2, 1, 0}, {19, 16, 18}));
  const Point<Patient> over = model->labels->geometry().X_PatientVoxel() * Point<Voxel>(14, 12, 21.5);
  ElasticSolution solution;
  const double firm = compliance(*cells_, *solver_, over, solution);
  // undercut: only the bone below
  for (double y = 6; y < 20; y += 2) model_ = cut(model_, {sweep_in(*model_, {6, y, 2}, {22, y, 2}, 2.6)});
  settle();
  expect_as_whole();
  EXPECT_GT(compliance(*cells_, *solver_, over, solution), 1.01 * firm);
}

TEST_F(CarvedCellsTest, DetachedTissueIsConstrainedUntilRestored) {
  const auto model = layered();
  begin(model, box_in(*model, {2, 1, 0}, {19, 16, 18}));
  const auto constrained_nodes = [&] {
    ElasticField u(cells_->grid().layout());
    std::fill(u.values.begin(), u.values.end(), 1.0f);
    solver_->zero_constrained(u);
    return std::count(u.values.begin(), u.values.end(), 0.0f);
  };
  const auto before = constrained_nodes();
  // a plane beneath and one on each side leave a disconnected block
  std::vector<Cut> cuts;
  for (double y = 5; y <= 21; y += 1) cuts.push_back(sweep_in(*model, {5, y, 12}, {18, y, 12}, 1.7, 1));
  for (double z = 12; z <= 24; z += 1) {
    for (const double y : {5.0, 21.0}) cuts.push_back(sweep_in(*model, {5, y, z}, {18, y, z}, 1.7, 1));
    for (const double x : {5.0, 18.0}) cuts.push_back(sweep_in(*model, {x, 5, z}, {x, 21, z}, 1.7, 1));
  }
  model_ = cut(model_, cuts);
  settle();
  expect_as_whole();
  const ElasticGrid& grid = cells_->grid();
  const Point<Patient> centre = model->labels->geometry().X_PatientVoxel() * Point<Voxel>(11, 13, 18);
  const Eigen::Vector3d at = box_.local_mm(centre) / box_.cell_mm;
  const int i = static_cast<int>(at.x()), j = static_cast<int>(at.y()), k = static_cast<int>(at.z());
  EXPECT_GT(grid.mu()[grid.layout().cell(i, j, k)], 0);
  ElasticField u(grid.layout());
  u.values[grid.layout().node(i, j, k, 0)] = 1;
  solver_->zero_constrained(u);
  EXPECT_EQ(u.values[grid.layout().node(i, j, k, 0)], 0);
  model_ = model_->carving->undone()->applied_to(*model_);
  settle();
  expect_as_whole();
  EXPECT_EQ(constrained_nodes(), before);
}

TEST_F(CarvedCellsTest, OverlappingCellsContinueTheirTransition) {
  const auto model = layered();
  begin(model, box_in(*model, {2, 1, 0}, {19, 16, 18}));
  model_ = cut(model_, {sweep_in(*model_, {10, 12, 20}, {20, 12, 20}, 3)});
  step();
  ASSERT_FALSE(cells_->changing_cells().empty());
  const ElasticBox moved = box_in(*model, {4, 0, 2}, {19, 16, 18});
  CarvedCells next(carved_labels(*model_), kMaterials, moved, about_);
  next.copy_overlap(*cells_, {2, -1, 2});
  for (int k = 0; k < 16; ++k)
    for (int j = 1; j < 16; ++j)
      for (int i = 0; i < 17; ++i)
        ASSERT_EQ(next.grid().cell(i, j, k).fill, cells_->grid().cell(i + 2, j - 1, k + 2).fill);
  ElasticSolver solver(next.grid());
  for (int n = 0; n < kStepsToFollow; ++n) next.follow(carved_labels(*model_), solver);
  expect_same(next.grid(), CarvedCells(carved_labels(*model_), kMaterials, moved, about_).grid());
}

TEST(ElasticCellTransition, FillChangeIsBounded) {
  const ElasticCell full{Matter::kSoft, 1, 2, 6}, half{Matter::kSoft, 0.5f, 1, 3}, none{},
      bone{Matter::kRigid, 1, 0, 0};
  const ElasticCell falls = step_towards(full, none, 0.2);
  EXPECT_FLOAT_EQ(falls.fill, 0.8f);
  EXPECT_FLOAT_EQ(falls.mu, 1.6f);
  EXPECT_FLOAT_EQ(falls.lambda, 4.8f);
  EXPECT_EQ(step_towards({Matter::kSoft, 0.15f, 0.3f, 0.9f}, none, 0.2), none);
  // no cell is left with almost no stiffness
  EXPECT_FLOAT_EQ(step_towards({Matter::kSoft, 0.2000001f, 0.4f, 1.2f}, none, 0.2).fill, 0.02f);
  const ElasticCell rises = step_towards(none, half, 0.2);
  EXPECT_EQ(rises.matter, Matter::kSoft);
  EXPECT_FLOAT_EQ(rises.fill, 0.2f);
  EXPECT_FLOAT_EQ(rises.mu, 0.4f);
  EXPECT_EQ(step_towards(bone, none, 0.2), none);
  EXPECT_EQ(step_towards(full, bone, 0.2), bone);
}

}  // namespace
}  // namespace palpate
