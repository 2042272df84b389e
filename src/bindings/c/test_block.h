#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate.h"

/// A block of bone in a small volume, as a C caller has it.
namespace palpate::c::test {

inline constexpr int kVoxels = 20;
inline constexpr double kTop_mm = 14;  ///< Surface of the block along +k, up to half a voxel

struct Destroy {
  void operator()(plp_model* model) const { plp_model_destroy(model); }
  void operator()(plp_session* session) const { plp_session_destroy(session); }
  void operator()(plp_run* run) const { plp_run_destroy(run); }
  void operator()(plp_loop* loop) const { plp_loop_destroy(loop); }
  void operator()(plp_recording* recording) const { plp_recording_destroy(recording); }
};
template <class Handle>
using Owned = std::unique_ptr<Handle, Destroy>;

struct Block {
  std::vector<std::uint16_t> voxels = std::vector<std::uint16_t>(kVoxels * kVoxels * kVoxels);
  plp_labels labels;
  plp_tissue tissue;
  plp_structure structure;

  Block() {
    for (int k = 6; k < 14; ++k)
      for (int j = 4; j < 16; ++j)
        for (int i = 4; i < 16; ++i) voxels[static_cast<std::size_t>((k * kVoxels + j) * kVoxels + i)] = 1;
    plp_labels_init(&labels, sizeof labels);
    labels.voxels = voxels.data();
    for (int& dim : labels.dims) dim = kVoxels;
    plp_tissue_init(&tissue, sizeof tissue);
    tissue.name = "bone";
    plp_structure_init(&structure, sizeof structure);
    structure.label = 1;
    structure.name = "block";
    structure.tissue = 0;
  }
  plp_status create(plp_model** model) const {
    return plp_model_create(&labels, &tissue, 1, &structure, 1, nullptr, 0, nullptr, model);
  }
  Owned<plp_model> model() const {
    plp_model* made = nullptr;
    EXPECT_EQ(create(&made), PLP_OK) << plp_last_error();
    return Owned<plp_model>(made);
  }
};

inline Owned<plp_session> session_of(const plp_model* model, int frame = PLP_PATIENT) {
  plp_session_options options;
  plp_session_options_init(&options, sizeof options);
  options.frame = frame;
  plp_session* session = nullptr;
  EXPECT_EQ(plp_session_create(model, &options, &session), PLP_OK) << plp_last_error();
  return Owned<plp_session>(session);
}

/// Poses of a tip that comes down onto the block within 600 ticks and rests 1 mm deep, in Patient.
inline std::vector<plp_pose> press(std::size_t ticks = 1000) {
  std::vector<plp_pose> poses(ticks);
  for (std::size_t n = 0; n < ticks; ++n) {
    plp_pose_init(&poses[n], sizeof poses[n]);
    const double distance = n < 600 ? static_cast<double>(n) / 600 : 1;
    poses[n].tip_mm[0] = poses[n].tip_mm[1] = 9.5;
    poses[n].tip_mm[2] = kTop_mm - 0.5 + 3 - 4 * distance;
  }
  return poses;
}

}  // namespace palpate::c::test
