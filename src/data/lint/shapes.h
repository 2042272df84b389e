#pragma once

#include <cstddef>
#include <vector>

#include "lint/lint_context.h"
#include "lint/voxel_runs.h"

/// Checks of the structures' shapes in one layer, which check_shapes() runs.
namespace palpate::internal {

/// State shared by the checks of one layer.
struct Layer {
  LintContext& context;
  std::size_t number;
  std::vector<const Segment*> segment_of_value;
  RunVolume runs;
  std::vector<Component> components;

  LabelId id_of(LabelId value) const {
    return value < segment_of_value.size() && segment_of_value[value] != nullptr ? segment_of_value[value]->id
                                                                                 : LabelId{0};
  }
};

/// Reports islands, and holes that a single structure encloses.
void report_islands(Layer& layer);
/// Reports parts of structures that are one voxel thin.
/// @param thin  thin voxels of the layer (cube_morphology())
void report_sheets(Layer& layer, RunVolume& thin);
/// Reports parts of structures that are joined by a thin neck only, and pockets of free space in a structure.
/// @param inner  voxels that remain after erosion by one voxel (cube_morphology())
void report_necks_and_pockets(Layer& layer, RunVolume& inner);
/// Reports seams, at which the cross-section changes abruptly, and terraces.
void report_seams_and_terraces(Layer& layer);
/// Reports structures that the border of the volume cuts.
void report_border_cuts(Layer& layer);

}  // namespace palpate::internal
