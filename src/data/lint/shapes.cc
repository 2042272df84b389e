#include "lint/shapes.h"

#include <array>
#include <utility>

#include "palpate/surfaces/surfaces.h"

namespace palpate::internal {

Result<void> check_shapes(LintContext& context, std::size_t number, const ProgressSpan& span) {
  const Volume<LabelId>& voxels = context.labels.layers[number];
  auto runs = runs_of(voxels, context.workers, context.progress, span.part(0, 0.2));
  if (!runs) return runs.error();
  Layer layer{context, number, {}, *std::move(runs), {}};
  for (const Segment& segment : context.labels.segments) {
    if (static_cast<std::size_t>(segment.layer) != number || segment.value == 0) continue;
    if (segment.value >= layer.segment_of_value.size()) layer.segment_of_value.resize(segment.value + 1u);
    layer.segment_of_value[segment.value] = &segment;
  }
  layer.components = connect(layer.runs);
  if (context.progress.stopped()) return Progress::interrupted();
  report_islands(layer);
  report_seams_and_terraces(layer);
  report_border_cuts(layer);
  if (context.progress.stopped()) return Progress::interrupted();
  auto cubes = cube_morphology(voxels, context.workers, context.progress, span.part(0.5, 0.8));
  if (!cubes) return cubes.error();
  report_sheets(layer, cubes->thin);
  if (context.progress.stopped()) return Progress::interrupted();
  report_necks_and_pockets(layer, cubes->inner);
  return {};
}

Result<void> check_leaks(LintContext& context, const Volume<LabelId>& flat) {
  std::vector<LabelId> ids;
  for (const SegmentStatistics& s : context.statistics) ids.push_back(s.id);
  const auto leaks = find_leaks(*label_bricks(flat), ids, context.options.threads, context.progress);
  if (!leaks) return leaks.error();
  constexpr std::size_t kManyJoints = 10;
  const auto X_VoxelPatient = context.grid.X_PatientVoxel().inverse();
  for (const Leaks& one : *leaks) {
    const Point<Voxel> at = X_VoxelPatient * one.position;
    context.add(
        LintKind::kLeakySheet, one.joints >= kManyJoints ? LintSeverity::kFault : LintSeverity::kWarning,
        {one.label},
        {static_cast<double>(one.joints), "", 0,
         std::array<int, 3>{static_cast<int>(at.x()), static_cast<int>(at.y()), static_cast<int>(at.z())}},
        context.name_of(one.label) + " is connected only by edges or corners in " +
            counted(one.joints, "place"));
  }
  return {};
}

}  // namespace palpate::internal
