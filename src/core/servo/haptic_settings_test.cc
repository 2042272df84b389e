#include "palpate/servo/haptic_settings.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <sstream>
#include <string>

namespace palpate {
namespace {

struct HalfNamed {
  double named = 1, not_named = 2;
  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("named", named);
  }
};
static_assert(!names_every_member<HalfNamed>());

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  return text.replace(text.find(what), what.size(), with);
}

TEST(HapticSettings, FirstDifferenceNamesTheSetting) {
  const std::string text = haptic_settings_text();
  EXPECT_EQ(first_haptic_difference(text), "");
  EXPECT_EQ(first_haptic_difference(replaced(text, "output.blend_s 0.1", "output.blend_s 0.2")),
            "output.blend_s 0.2, here 0.1");
  EXPECT_EQ(first_haptic_difference(replaced(text, "output.blend_s 0.1\n", "")),
            "output.blend_s absent, here 0.1");
  EXPECT_EQ(first_haptic_difference(text + "output.wind_s 3\n"), "output.wind_s 3, absent here");
  // text of a recording's header
  EXPECT_LT(text.size(), 8000u);
  for (const char byte : text) EXPECT_TRUE(byte == '\n' || (byte >= ' ' && byte <= '~'));
}

TEST(HapticSettings, NamesAreUnique) {
  std::set<std::string> names;
  visit_haptic_settings([&](const std::string& group, const std::string& name, double) {
    EXPECT_TRUE(names.insert(group + "." + name).second) << group << "." << name;
  });
}

TEST(HapticSettings, DocsListExactlyTheSettings) {
  std::ifstream docs(PALPATE_SOURCE_DIR "/docs/reference/feel.md");
  ASSERT_TRUE(docs);
  std::set<std::string> listed;
  for (std::string line; std::getline(docs, line);) {
    // table row: | `group.name` | value | description |
    if (line.rfind("| `", 0) != 0) continue;
    const std::size_t end = line.find("` | ", 3), value_end = line.find(" | ", end + 4);
    ASSERT_LT(value_end, line.size()) << line;
    EXPECT_GT(line.size(), value_end + 10) << line;
    listed.insert(line.substr(3, end - 3) + " " + line.substr(end + 4, value_end - end - 4));
  }
  std::set<std::string> all;
  std::istringstream lines(haptic_settings_text());
  for (std::string line; std::getline(lines, line);) all.insert(line);
  for (const std::string& setting : all) EXPECT_TRUE(listed.contains(setting)) << setting;
  for (const std::string& setting : listed) EXPECT_TRUE(all.contains(setting)) << setting;
}

}  // namespace
}  // namespace palpate
