#include <array>

#include "palpate/base/check.h"
#include "palpate/lint/lint.h"

namespace palpate {
namespace {

constexpr std::array kKinds{
    LintKindInfo{LintKind::kLeakySheet, "leaky_sheet", "Leaky sheet",
                 "Voxels of a sheet are connected only by edges or corners, so that free voxels of both "
                 "sides meet there. 10 such places or more are a fault.",
                 "a point tool may slip through",
                 "thicken the sheet to two voxels, or resample to finer voxels"},
    LintKindInfo{
        LintKind::kOneVoxelSheet, "one_voxel_sheet", "Sheet one voxel thick",
        "A patch of at least 12 voxels that no cube of 2 x 2 x 2 voxels of the structure covers. It covers "
        "100 mm2, or 30 mm2 and a twentieth of the structure, or a fifth of it, which is a fault.",
        "it has no interior that could push the tool out, so that contact is weak and the tool may pass",
        "segment on finer voxels, or enlarge the structure by half a voxel on each side"},
    LintKindInfo{
        LintKind::kNeck, "neck", "Bulge behind a neck",
        "A part of a structure is connected to it only by passages of at most two voxels. Without the "
        "structure's outermost voxels it is separate, with at least 12 voxels and 10 mm3. The structure is "
        "at least five voxels thick somewhere, and its largest part then keeps a quarter of its voxels.",
        "a tip meets a lump that may belong to a neighbour",
        "check whether the label leaked into a neighbour, and cut it off there"},
    LintKindInfo{LintKind::kOpenCavity, "open_cavity", "Cavity opened by a leak",
                 "Free space inside one structure reaches the outside only through passages of at most two "
                 "voxels. Without its outermost voxels it has at least 12 voxels and 10 mm3.",
                 "a tip may slip through the opening into a closed organ",
                 "close the opening where the wall is intact in the scan"},
    LintKindInfo{LintKind::kIslands, "islands", "Islands",
                 "Components (voxels that share a face, an edge or a corner) below 2 % of the structure's "
                 "largest one and of at most 1000 mm3.",
                 "the tip touches a grain that does not exist in the patient", "remove them (--fix)", true},
    LintKindInfo{LintKind::kHoles, "holes", "Enclosed holes",
                 "Free space that one structure encloses on all sides, of at most 2 % of its volume and 1000 "
                 "mm3. Whether a larger cavity is anatomy cannot be decided.",
                 "a tool that penetrates deeply falls into it", "fill them (--fix)", true},
    LintKindInfo{LintKind::kNarrowGap, "narrow_gap", "Gap narrower than the tool",
                 "Free space between surfaces is narrower than the tool's diameter along an axis of the "
                 "grid, over at least 20 mm2. Crevices along a line of contact do not count.",
                 "the tool touches both sides and does not fit between them",
                 "use a thinner tool, or check whether the structures touch in the scan"},
    LintKindInfo{LintKind::kSeam, "seam", "Seam",
                 "The cross-sections of several structures change in one plane 3 times as much as the median "
                 "of the three planes on either side. They change 1.5 times as much as in any of these, and "
                 "by a twentieth of their area. If one structure changes 4 and 2 times as much, by 40 "
                 "voxels, while its area stays constant, it is a warning.",
                 "a step runs across the surface at a border of tiles or patches",
                 "predict with overlapping patches, or segment again around the plane"},
    LintKindInfo{LintKind::kTerraces, "terraces", "Terraces",
                 "Slices repeat their neighbours between jumps of the outline. Slices at least 2.5 times "
                 "as thick as the voxels are wide are a warning.",
                 "the surface has steps as high as the repeated or thick slices",
                 "interpolate the shape between slices instead of repeating them"},
    LintKindInfo{LintKind::kSwappedSides, "swapped_sides", "Swapped or mirrored sides",
                 "A structure with left in its name lies to the right of its partner, or the spleen to the "
                 "right of liver or gallbladder. If all pairs do, the map is mirrored.",
                 "a structure felt on the left is named as the right one",
                 "correct the names, or the directions in the file's header"},
    LintKindInfo{LintKind::kCutByBorder, "cut_by_border", "Cut by the volume's border",
                 "Voxels of a structure lie on the outermost layer of the volume, over at least 5 mm2.",
                 "the surface ends there in a flat face that does not exist in the patient",
                 "keep the tool away from that face, or segment a larger scan"},
    LintKindInfo{LintKind::kOverlap, "overlap", "Overlapping structures",
                 "Two structures share at least 10 voxels and between 0.1 % and 90 % of the smaller one, "
                 "which is not nested. Two that are the same voxels are a fault.",
                 "a voxel belongs to one tissue in touch, so that one of them loses its surface there",
                 "assign the shared voxels to one of them"},
    LintKindInfo{LintKind::kNoName, "no_name", "No name", "A structure without a name in any file.",
                 "no tissue can be assigned by name, and it cannot be referred to",
                 "name it in a table (--names)", true},
    LintKindInfo{LintKind::kDuplicateName, "duplicate_name", "Name used twice",
                 "Two structures have one name, capitals and spaces aside.",
                 "a scene that names it selects both", "give each a different name (--fix numbers them)",
                 true},
    LintKindInfo{LintKind::kNoVoxels, "no_voxels", "Structure without voxels",
                 "A structure that the file names but that has no voxel, or a map without any structure.",
                 "nothing is felt in a scene that names it",
                 "remove it from the list, or check why it was not segmented"},
    LintKindInfo{LintKind::kOutsideBody, "outside_body", "Outside the body",
                 "At least 10 voxels and 2 % of a structure lie in the air around the body, which is "
                 "connected with an edge of the volume. Air is below -400 HU. In other scans it is below a "
                 "tenth of the range, which is only a warning, because bone may be as dark.",
                 "it is felt in front of the skin",
                 "remove it, or check that labels and scan belong together"},
    LintKindInfo{LintKind::kOutsideScan, "outside_scan", "Outside the scan",
                 "At least 5 % of a structure outside the scan's voxels.",
                 "it is felt where the scan shows nothing", "give the scan that the labels were made on"},
    LintKindInfo{
        LintKind::kUnreachable, "unreachable", "Out of the tool's reach",
        "No path of the tool's ball from outside the volume to the structure passes only through free space "
        "and soft structures. If it is unknown which structures are soft, it cannot be decided.",
        "it can never be felt",
        "use a thinner tool, open the enclosing structure, or leave it out of the scene"},
};

}  // namespace

std::span<const LintKindInfo> lint_kinds() {
  return kKinds;
}

const LintKindInfo& lint_kind(LintKind kind) {
  const LintKindInfo& info = kKinds.at(static_cast<std::size_t>(kind));
  PALPATE_CHECK(info.kind == kind);
  return info;
}

std::string lint_kind_table() {
  std::string text = "| kind | when it is reported | in touch |\n|---|---|---|\n";
  for (const LintKindInfo& info : lint_kinds())
    text += "| " + std::string(info.title) + " (`" + std::string(info.key) + "`) | " +
            std::string(info.definition) + " | " + std::string(info.effect) + " |\n";
  return text;
}

std::string_view in_words(LintSeverity severity) {
  constexpr std::array<std::string_view, 3> kWords{"fault", "warning", "cannot tell"};
  return kWords.at(static_cast<std::size_t>(severity));
}

std::size_t LintReport::count(LintSeverity severity) const {
  std::size_t n = 0;
  for (const LintFinding& finding : findings) n += finding.severity == severity;
  return n;
}

}  // namespace palpate
