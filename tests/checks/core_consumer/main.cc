#include <cmath>
#include <cstdio>
#include <memory>
#include <utility>

#include "palpate/model/changed_model.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"

// a third-party simulator: a segmented ball, a tip pressed into it with the proxy method, and a hole cut
// under the tip while in contact
namespace {

constexpr double kStiffness_N_per_mm = 1, kRadius_mm = 8, kVoxel_mm = 0.6, kDepth_mm = 1;
constexpr int kVoxels = 37;

// around the patient's origin
palpate::ModelParts ball_of_bone() {
  palpate::GridGeometry grid;
  grid.dims = {kVoxels, kVoxels, kVoxels};
  grid.spacing_mm.setConstant(kVoxel_mm);
  const double corner_mm = -0.5 * (kVoxels - 1) * kVoxel_mm;
  grid.origin = palpate::Point<palpate::Patient>(corner_mm, corner_mm, corner_mm);
  palpate::Volume<palpate::LabelId> labels(grid);
  for (int k = 0; k < kVoxels; ++k)
    for (int j = 0; j < kVoxels; ++j)
      for (int i = 0; i < kVoxels; ++i)
        labels.at(i, j, k) = std::hypot(corner_mm + i * kVoxel_mm, corner_mm + j * kVoxel_mm,
                                        corner_mm + k * kVoxel_mm) < kRadius_mm;

  palpate::Tissue bone;
  bone.name = "bone";
  bone.stiffness_N_per_mm = kStiffness_N_per_mm;
  palpate::ModelParts parts;
  parts.labels = palpate::label_bricks(labels);
  parts.segments = {{1, "ball", {}, 0, 1}};
  parts.tissues = {bone};
  parts.tissue_of_label = {-1, 0};
  return parts;
}

class Simulator {
 public:
  explicit Simulator(const palpate::Model& model) : X_WorldPatient_(model.X_WorldPatient) {
    parameters_.method = palpate::ForceMethod::kProxy;
  }

  // moves the tip to `height_mm` above the ball's centre within 0.5 s; returns the final force, Patient
  palpate::Vector<palpate::Patient> hold(const palpate::Model& model, double height_mm) {
    constexpr int kTicks = 500;
    const double from_mm = height_mm_;
    for (int n = 1; n <= kTicks; ++n) {
      height_mm_ = from_mm + (height_mm - from_mm) * n / kTicks;
      device_.tip = X_WorldPatient_ * palpate::Point<palpate::Patient>(0, 0, height_mm_);
      palpate::tick(model, parameters_, {&device_, 1}, 1e-3, state_, {&wrench_, 1}, record_);
    }
    return X_WorldPatient_.inverse() * wrench_.force_N;
  }

 private:
  palpate::Transform<palpate::World, palpate::Patient> X_WorldPatient_;
  palpate::Parameters parameters_;
  palpate::DeviceState device_;
  palpate::SessionState state_;
  palpate::Wrench wrench_;
  palpate::TickRecord record_;
  double height_mm_ = kRadius_mm + 3;
};

bool is_about(const char* when, const palpate::Vector<palpate::Patient>& force_N, double expected_N) {
  std::printf("%s: %.4f N along +k, expected %.4f N\n", when, force_N.eigen().z(), expected_N);
  return std::abs(force_N.eigen().z() - expected_N) < 0.1 && force_N.eigen().head<2>().norm() < 0.1;
}

}  // namespace

int main() {
  auto made = palpate::make_model(ball_of_bone());
  if (!made) return std::puts(made.error().message().c_str()), 1;
  const palpate::ForceMethod proxy = palpate::ForceMethod::kProxy;
  auto prepared = palpate::prepared_for(*std::move(made), {&proxy, 1});
  if (!prepared) return std::puts(prepared.error().message().c_str()), 1;

  // the force comes in over half a second in free space, and follows the depth
  Simulator simulator(**prepared);
  const double pressed_mm = kRadius_mm - kDepth_mm;
  simulator.hold(**prepared, kRadius_mm + 2);
  simulator.hold(**prepared, pressed_mm);
  bool good = is_about("pressed", simulator.hold(**prepared, pressed_mm), kStiffness_N_per_mm * kDepth_mm);

  // a ball of 3 mm is cut away around the tip, whose next tick is in the open
  const palpate::Point<palpate::Patient> tip(0, 0, pressed_mm);
  const palpate::Cut hole{.sweep = {tip, tip, 3}};
  const palpate::ModelChange cut{.version = (*prepared)->version + 1, .tissue = palpate::ModelChange::kCut};
  const auto next = palpate::next_version({*prepared, *prepared}, cut, {&hole, 1});
  if (!next) return std::puts(next.error().message().c_str()), 1;
  good = is_about("cut", simulator.hold(*next->current, pressed_mm), 0) && good;
  // the hole's bottom lies as deep as the ball reached
  const double bottom_mm = pressed_mm - 3;
  good =
      is_about("at the bottom", simulator.hold(*next->current, bottom_mm - 0.5), 0.5 * kStiffness_N_per_mm) &&
      good;
  return good ? 0 : 1;
}
