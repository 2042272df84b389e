#include "leak_text.h"

#include <algorithm>
#include <cstdio>

namespace palpate::app {

std::string describe_leaks(std::vector<Leaks> leaks, const std::function<std::string(LabelId)>& name_of) {
  constexpr std::size_t kNamed = 12;
  std::stable_sort(leaks.begin(), leaks.end(),
                   [](const Leaks& a, const Leaks& b) { return a.joints > b.joints; });
  std::string text =
      "leaky: a point tool may slip through where voxels are connected only by edges or corners; number of "
      "such places: ";
  for (std::size_t n = 0; n < std::min(leaks.size(), kNamed); ++n) {
    char position_text[80];
    std::snprintf(position_text, sizeof position_text, " (one at %.1f, %.1f, %.1f mm)", leaks[n].position.x(),
                  leaks[n].position.y(), leaks[n].position.z());
    text += (n == 0 ? "" : ", ") + name_of(leaks[n].label) + " " + std::to_string(leaks[n].joints) +
            position_text;
  }
  if (leaks.size() > kNamed) text += " and " + std::to_string(leaks.size() - kNamed) + " more";
  return text;
}

}  // namespace palpate::app
