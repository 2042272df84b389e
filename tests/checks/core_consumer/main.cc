#include <cmath>
#include <cstdio>
#include <memory>
#include <utility>

#include "palpate/servo.h"

// somebody else's simulator: a block that grows stiffer downwards, one tip pressed into it, until the force
// has come in
int main() {
  palpate::GridGeometry grid;
  grid.dims = {16, 16, 16};
  palpate::Volume<std::uint8_t> ramp(grid);
  palpate::Volume<palpate::LabelId> labels(grid, 1);
  for (int k = 0; k < 16; ++k)
    for (int j = 0; j < 16; ++j)
      for (int i = 0; i < 16; ++i) ramp.at(i, j, k) = static_cast<std::uint8_t>(16 * (15 - k));

  palpate::Model model;
  model.field = std::make_shared<const palpate::Field>(std::move(ramp));
  model.labels = palpate::label_bricks(labels);
  model.segments = {{1, "block", {}, 0, 1}};
  model.tissues.resize(1);
  model.tissue_of_label = {-1, 0};
  model.level_of_label = {0.0f, 1.0f};
  model.tissues[0].stiffness_N_per_mm = 1.0;
  const auto trilinear = palpate::make_force_field(model, palpate::ForceMethod::kTrilinear);
  if (!trilinear) return 1;
  model.methods[0] = *trilinear;
  model.X_WorldPatient = palpate::supine_from_feet(grid);

  palpate::DeviceState device;
  device.tip = model.X_WorldPatient * grid.centre();
  palpate::SessionState state;
  palpate::Wrench wrench;
  palpate::TickRecord record;
  // the force comes in over half a second
  for (int n = 0; n < 600; ++n) palpate::tick(model, {}, {&device, 1}, 1e-3, state, {&wrench, 1}, record);

  // the field at the centre is 7.5 voxels deep: 120/255 of the full force, towards +k
  const palpate::Vector<palpate::Patient> force = model.X_WorldPatient.inverse() * wrench.force_N;
  const double expected = (*trilinear)->full_force_N() * 120.0 / 255.0;
  std::printf("force %.4f N, expected %.4f N along +k\n", force.eigen().z(), expected);
  return std::abs(force.eigen().z() - expected) < 1e-3 && force.eigen().head<2>().norm() < 1e-6 ? 0 : 1;
}
