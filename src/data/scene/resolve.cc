#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "palpate/scene/scene.h"
#include "scene/keys.h"

namespace palpate {
namespace {

std::string quoted(const LabelReference& label) {
  if (const auto* number = std::get_if<int>(&label)) return std::to_string(*number);
  return "\"" + std::get<std::string>(label) + "\"";
}

/// Index of the label map's segments by number and by name.
class Index {
 public:
  explicit Index(const LabelMap& labels) {
    for (const Segment& segment : labels.segments) {
      by_number_[segment.id].push_back(segment.id);
      by_name_[segment.name].push_back(segment.id);
    }
  }
  /// Ids that a reference denotes: one id, or all segments of that name.
  const std::vector<LabelId>& find(const LabelReference& label) const {
    static const std::vector<LabelId> none;
    if (const auto* number = std::get_if<int>(&label)) {
      const auto found = by_number_.find(*number);
      return found == by_number_.end() ? none : found->second;
    }
    const auto found = by_name_.find(std::get<std::string>(label));
    return found == by_name_.end() ? none : found->second;
  }

 private:
  std::map<int, std::vector<LabelId>> by_number_;
  std::map<std::string_view, std::vector<LabelId>> by_name_;
};

/// List of the labels present in the map, truncated to one line.
std::string known_labels(const LabelMap& labels) {
  constexpr std::size_t kMaxListed = 400;
  if (labels.segments.empty()) return "the label map is empty";
  std::string list = "the label map has ";
  for (const Segment& segment : labels.segments) {
    if (&segment != &labels.segments.front()) list += ", ";
    if (list.size() > kMaxListed) return list + "...";
    list += std::to_string(segment.id);
    if (!segment.name.empty()) list += " " + segment.name;
  }
  return list;
}

/// @param owner  owner of the reference in the error: "tissue \"bone\""
Error absent_label(const std::string& owner, const LabelReference& label, std::string where,
                   const LabelMap& labels) {
  std::string meant;
  if (const auto* name = std::get_if<std::string>(&label)) {
    std::vector<std::string_view> names;
    for (const Segment& segment : labels.segments) names.push_back(segment.name);
    meant = did_you_mean(*name, names, "\"");
  }
  return {ErrorKind::kBadInput, owner + " has the label " + quoted(label) + ", which the label map lacks",
          std::move(where), meant + known_labels(labels)};
}

}  // namespace

Result<std::vector<std::vector<LabelId>>> resolve_labels(const Scene& scene, const LabelMap& labels) {
  std::vector<std::vector<LabelId>> ids_of_tissue(scene.tissues.size());
  const Index index(labels);
  std::map<LabelId, const TissueSettings*> owner;
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    const TissueSettings& tissue = scene.tissues[i];
    PALPATE_CHECK(tissue.label_lines.size() == tissue.labels.size());
    for (std::size_t n = 0; n < tissue.labels.size(); ++n) {
      const LabelReference& label = tissue.labels[n];
      const std::vector<LabelId>& ids = index.find(label);
      if (ids.empty() && !tissue.optional)
        return absent_label("tissue \"" + tissue.name + "\"", label, scene.where(tissue.label_lines[n]),
                            labels);
      for (const LabelId id : ids) {
        const auto [entry, fresh] = owner.emplace(id, &tissue);
        if (!fresh) {
          return Error{ErrorKind::kBadInput,
                       "tissue \"" + tissue.name + "\" claims label " + quoted(label) + ", which \"" +
                           entry->second->name + "\" (line " + std::to_string(entry->second->line) +
                           ") already has",
                       scene.where(tissue.label_lines[n]), "leave each structure in one tissue, once"};
        }
        ids_of_tissue[i].push_back(id);
      }
    }
    std::sort(ids_of_tissue[i].begin(), ids_of_tissue[i].end());
  }
  return ids_of_tissue;
}

Result<std::vector<std::vector<LabelId>>> resolve_no_go(const Scene& scene, const LabelMap& labels) {
  std::vector<std::vector<LabelId>> ids_of_region(scene.no_go.size());
  const Index index(labels);
  for (std::size_t i = 0; i < scene.no_go.size(); ++i) {
    const NoGoSettings& region = scene.no_go[i];
    PALPATE_CHECK(region.structure_lines.size() == region.structures.size());
    for (std::size_t n = 0; n < region.structures.size(); ++n) {
      const std::vector<LabelId>& ids = index.find(region.structures[n]);
      if (ids.empty())
        return absent_label("no-go region \"" + region.name + "\"", region.structures[n],
                            scene.where(region.structure_lines[n]), labels);
      ids_of_region[i].insert(ids_of_region[i].end(), ids.begin(), ids.end());
    }
    std::sort(ids_of_region[i].begin(), ids_of_region[i].end());
    ids_of_region[i].erase(std::unique(ids_of_region[i].begin(), ids_of_region[i].end()),
                           ids_of_region[i].end());
  }
  return ids_of_region;
}

}  // namespace palpate
