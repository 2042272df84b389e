#include "palpate/scene/structures.h"

#include "scene/keys.h"

namespace palpate {
namespace {

std::string reported_structure(const Segment& segment) {
  return segment.name.empty() ? "label " + std::to_string(segment.id) : segment.name;
}

std::string structures_there(const Model& model) {
  constexpr std::size_t kMaxListed = 30;
  std::string text = "its structures are ";
  std::size_t listed = 0;
  for (const Segment& segment : model.segments) {
    if (listed == kMaxListed) return text + ", ...";
    text += (listed++ ? ", " : "") + reported_structure(segment);
  }
  return text;
}

}  // namespace

Result<std::vector<bool>> labels_in_model(const Model& model, const std::vector<LabelReference>& references,
                                          const std::string& where) {
  std::vector<bool> has;
  for (const LabelReference& reference : references) {
    const auto* number = std::get_if<int>(&reference);
    const auto* name = std::get_if<std::string>(&reference);
    bool found = false;
    for (const Segment& segment : model.segments) {
      if (number != nullptr ? segment.id != *number : segment.name != *name) continue;
      if (has.size() <= segment.id) has.resize(segment.id + 1u);
      has[segment.id] = found = true;
    }
    if (found) continue;
    std::string meant;
    if (name != nullptr) {
      std::vector<std::string_view> names;
      for (const Segment& segment : model.segments) names.push_back(segment.name);
      meant = did_you_mean(*name, names, "\"");
    }
    return Error{ErrorKind::kBadInput,
                 "the scene has no " +
                     (name != nullptr ? "structure \"" + *name + "\"" : "label " + std::to_string(*number)),
                 where, meant + structures_there(model)};
  }
  return has;
}

}  // namespace palpate
