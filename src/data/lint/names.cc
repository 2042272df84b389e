#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "lint/lint_context.h"
#include "palpate/volume/overlaps.h"

/// Checks that use the list of structures: names, sides, overlaps.
namespace palpate::internal {
namespace {

std::vector<std::string> words_of_name(const std::string& plain) {
  std::vector<std::string> words{""};
  for (const char c : plain) {
    if (c == ' ')
      words.emplace_back();
    else
      words.back() += c;
  }
  return words;
}

enum class NamedSide : std::uint8_t { kLeft, kRight };

std::optional<NamedSide> side_of_word(const std::string& word) {
  constexpr std::array<std::string_view, 6> kLeft{"left", "l", "lt", "lh", "sinister", "sin"};
  constexpr std::array<std::string_view, 6> kRight{"right", "r", "rt", "rh", "dexter", "dex"};
  if (std::ranges::find(kLeft, word) != kLeft.end()) return NamedSide::kLeft;
  if (std::ranges::find(kRight, word) != kRight.end()) return NamedSide::kRight;
  return std::nullopt;
}

/// A structure on the left side and its counterpart on the right.
struct SidePair {
  LabelId left = 0, right = 0;
};

std::vector<SidePair> pairs_of(const LintContext& context) {
  // by name, with the word for the side replaced by *
  std::map<std::string, std::array<std::vector<LabelId>, 2>> sides;
  std::vector<LabelId> of_left, of_right;
  for (const SegmentStatistics& s : context.statistics) {
    const std::vector<std::string> words = words_of_name(plain_name(context.labels.find(s.id)->name));
    for (std::size_t n = 0; n < words.size(); ++n) {
      if (words[n] == "liver" || words[n] == "gallbladder") of_right.push_back(s.id);
      if (words[n] == "spleen") of_left.push_back(s.id);
      const auto side = side_of_word(words[n]);
      if (!side) continue;
      std::string rest;
      for (std::size_t m = 0; m < words.size(); ++m) rest += (m == n ? "*" : words[m]) + " ";
      sides[rest][*side == NamedSide::kLeft ? 0 : 1].push_back(s.id);
    }
  }
  std::vector<SidePair> pairs;
  for (const auto& [rest, both] : sides)
    if (both[0].size() == 1 && both[1].size() == 1) pairs.push_back({both[0][0], both[1][0]});
  // organs that lie on the same side in everybody, if each occurs once
  if (of_left.size() == 1 && of_right.size() == 1) pairs.push_back({of_left[0], of_right[0]});
  return pairs;
}

}  // namespace

std::string plain_name(const std::string& name) {
  std::string plain;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0 || byte >= 0x80)
      plain += static_cast<char>(std::tolower(byte));
    else if (!plain.empty() && plain.back() != ' ')
      plain += ' ';
  }
  while (!plain.empty() && plain.back() == ' ') plain.pop_back();
  return plain;
}

void check_names(LintContext& context) {
  if (context.labels.segments.empty())
    context.add(LintKind::kNoVoxels, LintSeverity::kFault, {}, {}, "the map has no structure");
  std::vector<LabelId> unnamed;
  std::map<std::string, std::vector<LabelId>> by_name;
  for (const Segment& segment : context.labels.segments) {
    if (segment.name.empty())
      unnamed.push_back(segment.id);
    else
      by_name[plain_name(segment.name)].push_back(segment.id);
    if (context.statistics_of(segment.id) == nullptr)
      context.add(LintKind::kNoVoxels, LintSeverity::kFault, {segment.id}, {},
                  context.name_of(segment.id) + " has no voxels");
  }
  if (!unnamed.empty())
    context.add(LintKind::kNoName, LintSeverity::kFault, unnamed, {static_cast<double>(unnamed.size()), ""},
                unnamed.size() == context.labels.segments.size()
                    ? "no structure has a name"
                    : context.names_of(unnamed) + (unnamed.size() == 1 ? " has no name" : " have no names"));
  for (const auto& [name, ids] : by_name)
    if (ids.size() > 1) {
      std::string numbers;
      for (const LabelId id : ids) numbers += (numbers.empty() ? "" : ", ") + std::to_string(id);
      context.add(LintKind::kDuplicateName, LintSeverity::kFault, ids, {static_cast<double>(ids.size()), ""},
                  counted(ids.size(), "structure") + " are called " + context.name_of(ids.front()) +
                      ": labels " + numbers);
    }
}

void check_sides(LintContext& context) {
  if (context.statistics.empty()) return;
  if (!context.options.oriented) {
    context.add(LintKind::kSwappedSides, LintSeverity::kUndetermined, {}, {},
                "sides cannot be checked: the file does not state its orientation in the patient");
    return;
  }
  const std::vector<SidePair> pairs = pairs_of(context);
  if (pairs.empty()) {
    context.add(LintKind::kSwappedSides, LintSeverity::kUndetermined, {}, {},
                "sides cannot be checked: no pair of structures is named left and right");
    return;
  }
  // minimum distance of the centroids along the patient's left-right axis that decides which side is which
  constexpr double kSeparation_mm = 2;
  std::vector<LabelId> wrong;
  double max_mm = 0;
  std::size_t decided = 0, contrary = 0;
  for (const SidePair& pair : pairs) {
    // LPS: x grows towards the patient's left
    const double separation_mm =
        context.statistics_of(pair.left)->centroid.x() - context.statistics_of(pair.right)->centroid.x();
    if (std::abs(separation_mm) < kSeparation_mm) continue;
    ++decided;
    if (separation_mm > 0) continue;
    ++contrary;
    for (const LabelId id : {pair.left, pair.right})
      if (std::ranges::find(wrong, id) == wrong.end()) wrong.push_back(id);
    max_mm = std::max(max_mm, -separation_mm);
  }
  if (decided == 0) {
    context.add(LintKind::kSwappedSides, LintSeverity::kUndetermined, {}, {},
                "sides cannot be checked: structures named left and right overlap");
    return;
  }
  if (contrary == 0) return;
  const SegmentStatistics* first = context.statistics_of(wrong.front());
  const Point<Voxel> at = context.grid.X_PatientVoxel().inverse() * first->centroid;
  std::array<int, 3> voxel;
  for (std::size_t a = 0; a < 3; ++a)
    voxel[a] = std::clamp(static_cast<int>(std::lround(at.eigen()[static_cast<Eigen::Index>(a)])), 0,
                          context.grid.dims[a] - 1);
  const bool is_mirrored = contrary == decided;
  context.add(LintKind::kSwappedSides, LintSeverity::kFault,
              is_mirrored && decided > 1 ? std::vector<LabelId>() : wrong, {max_mm, "mm", 0, voxel},
              is_mirrored && decided > 1 ? "the map is mirrored: in all of " + counted(decided, "pair") +
                                               " the left structure lies to the right"
                                         : context.names_of(wrong) + " are on each other's side" +
                                               (is_mirrored ? ", or the map is mirrored" : ""));
}

void check_overlaps(LintContext& context) {
  constexpr std::size_t kOverlap_voxels = 10;
  constexpr double kOverlapFraction = 0.001, kSameFraction = 0.99;
  for (const SegmentOverlap& overlap : segment_overlaps(context.labels)) {
    const SegmentStatistics *one = context.statistics_of(overlap.smaller),
                            *other = context.statistics_of(overlap.larger);
    const bool is_same =
        overlap.fraction >= kSameFraction &&
        static_cast<double>(one->voxels) >= kSameFraction * static_cast<double>(other->voxels);
    if (!is_same &&
        (overlap.is_nested() || overlap.voxels < kOverlap_voxels || overlap.fraction < kOverlapFraction))
      continue;
    // a shared voxel
    const Segment *a = context.labels.find(overlap.smaller), *b = context.labels.find(overlap.larger);
    const auto& of_a = context.labels.layers[static_cast<std::size_t>(a->layer)];
    const auto& of_b = context.labels.layers[static_cast<std::size_t>(b->layer)];
    std::optional<std::array<int, 3>> voxel;
    for (int k = one->box_min[2]; k <= one->box_max[2] && !voxel; ++k)
      for (int j = one->box_min[1]; j <= one->box_max[1] && !voxel; ++j)
        for (int i = one->box_min[0]; i <= one->box_max[0] && !voxel; ++i)
          if (of_a.at(i, j, k) == a->value && of_b.at(i, j, k) == b->value) voxel = {i, j, k};
    const double mm3 = static_cast<double>(overlap.voxels) * context.grid.voxel_volume_mm3();
    context.add(LintKind::kOverlap, is_same ? LintSeverity::kFault : LintSeverity::kWarning,
                {overlap.smaller, overlap.larger}, {mm3, "mm3", overlap.voxels, voxel},
                is_same ? context.name_of(overlap.smaller) + " and " + context.name_of(overlap.larger) +
                              " are the same voxels"
                        : context.name_of(overlap.smaller) + " and " + context.name_of(overlap.larger) +
                              " share " + figure(mm3, "mm3") + ", " + figure(100 * overlap.fraction, "%") +
                              " of the first");
  }
}

}  // namespace palpate::internal
