#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <optional>
#include <sstream>

#include "base/test_docs.h"
#include "palpate/base/file.h"
#include "palpate/scene/plan_file.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/script.h"
#include "palpate/scene/task_file.h"
#include "palpate/scene/tissue_presets.h"

namespace palpate {
namespace {

void check_section(const std::string& file, const std::string& name, const std::string& expected) {
  test::check_docs_section(PALPATE_SOURCE_DIR, file, name, expected);
}

TEST(Docs, SceneListsEveryPreset) {
  check_section("reference/presets.md", "presets", tissue_preset_table());
}
TEST(Docs, SceneKeysListPresetProperties) {
  check_section("reference/presets.md", "elastic", elastic_preset_table());
}
TEST(Docs, SceneListsHowPresetsRelax) {
  check_section("reference/presets.md", "relaxation", relaxation_preset_table());
}
TEST(Docs, TasksListEveryMetric) {
  check_section("reference/metrics.md", "metrics", metric_table());
}

/// A fenced TOML block of the manual.
struct Example {
  std::string where, text;
};

/// All fenced TOML blocks that are not marked as excluded.
std::vector<Example> examples() {
  std::vector<Example> blocks;
  const std::filesystem::path docs = PALPATE_SOURCE_DIR "/docs";
  for (const auto& entry : std::filesystem::recursive_directory_iterator(docs)) {
    if (entry.path().extension() != ".md") continue;
    const auto text = read_file(entry.path().string());
    if (!text) continue;
    bool runs = true;
    std::optional<std::string> block;
    std::istringstream lines(*text);
    for (std::string line; std::getline(lines, line);) {
      if (block && line != "```") {
        *block += line + "\n";
      } else if (block) {
        if (runs) blocks.push_back({std::filesystem::relative(entry.path(), docs).string(), *block});
        block.reset();
      } else if (line == "```toml") {
        block.emplace();
      } else if (!line.empty()) {
        runs = !line.starts_with("<!-- not run:");
      }
    }
  }
  return blocks;
}

/// Detects the kind of file by a table that only it has, then parses the block.
Result<std::string> read_by_its_parser(const Example& example) {
  const auto has = [&](const char* table) { return ("\n" + example.text).find(table) != std::string::npos; };
  const auto kind = [](const auto& parsed, const char* name) -> Result<std::string> {
    if (!parsed) return parsed.error();
    return std::string(name);
  };
  if (has("\n[[trajectory]]") || has("\n[[keep_away]]"))
    return kind(parse_plan(example.text, example.where), "plan");
  if (has("\n[[metric]]")) return kind(parse_task(example.text, example.where), "task");
  if (has("\n[[tissue]]")) return kind(parse_scene(example.text, example.where), "scene");
  return kind(parse_script(example.text, example.where), "script");
}

TEST(Docs, EveryExampleIsReadByItsParser) {
  std::map<std::string, int> counts;
  for (const Example& example : examples()) {
    const auto kind = read_by_its_parser(example);
    EXPECT_TRUE(kind.ok()) << kind.error().message() << "\n" << example.text;
    if (kind) ++counts[*kind];
  }
  for (const char* kind : {"plan", "task", "scene", "script"}) EXPECT_GE(counts[kind], 1) << kind;
}

}  // namespace
}  // namespace palpate
