#include <gtest/gtest.h>

#include <fstream>

#include "palpate/base/file.h"
#include "palpate/scene/plan_file.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/task_file.h"

namespace palpate {
namespace {

/// Compares what stands between "<!-- NAME begin -->" and "<!-- NAME end -->" in a file of docs/ with what
/// the declarations say. With PALPATE_UPDATE_DOCS in the environment it writes it there instead.
void check_section(const std::string& file, const std::string& name, const std::string& expected) {
  const std::string path = std::string(PALPATE_SOURCE_DIR "/docs/") + file;
  auto text = read_file(path);
  ASSERT_TRUE(text.ok()) << text.error().message();
  const std::string begin = "<!-- " + name + " begin -->\n", end = "<!-- " + name + " end -->";
  const std::size_t first = text->find(begin), last = text->find(end);
  ASSERT_NE(first, std::string::npos) << path << " has no " << begin;
  ASSERT_NE(last, std::string::npos) << path << " has no " << end;
  const std::size_t body = first + begin.size();
  if (std::getenv("PALPATE_UPDATE_DOCS")) {
    text->replace(body, last - body, expected);
    ASSERT_TRUE(write_file(path, *text).ok());
    return;
  }
  EXPECT_EQ(text->substr(body, last - body), expected)
      << "docs/" << file
      << " is behind the declarations: PALPATE_UPDATE_DOCS=1 scene_test --gtest_filter='Docs.*'";
}

TEST(Docs, SceneListsEveryKey) {
  check_section("reference/scene-keys.md", "keys", scene_keys());
}
TEST(Docs, SceneListsEveryPreset) {
  check_section("reference/presets.md", "presets", tissue_preset_table());
}
TEST(Docs, SceneListsWhatEveryPresetIsMadeOf) {
  check_section("reference/presets.md", "elastic", elastic_preset_table());
}
TEST(Docs, SceneListsHowPresetsRelax) {
  check_section("reference/presets.md", "relaxation", relaxation_preset_table());
}
TEST(Docs, ScriptListsEveryKey) {
  check_section("reference/script-keys.md", "keys", script_keys());
}

TEST(Docs, TasksListEveryKey) {
  check_section("reference/task-keys.md", "keys", task_keys());
}
TEST(Docs, TasksListEveryMetric) {
  check_section("reference/metrics.md", "metrics", metric_table());
}

TEST(Docs, RehearsalListsEveryKey) {
  check_section("reference/plan-keys.md", "keys", plan_keys());
}

/// The fenced TOML blocks of a document.
std::vector<std::string> examples(const std::string& file) {
  const auto text = read_file(std::string(PALPATE_SOURCE_DIR "/docs/") + file);
  std::vector<std::string> blocks;
  if (!text) return blocks;
  for (std::size_t at = text->find("```toml\n"); at != std::string::npos; at = text->find("```toml\n", at)) {
    at += 8;
    blocks.push_back(text->substr(at, text->find("```", at) - at));
  }
  return blocks;
}

TEST(Docs, ExamplesOfScenesParse) {
  const auto blocks = examples("guide/scene.md");
  EXPECT_GE(blocks.size(), 2u);
  for (const std::string& block : blocks) {
    const auto scene = parse_scene(block, "guide/scene.md");
    EXPECT_TRUE(scene.ok()) << scene.error().message() << "\n" << block;
  }
}

TEST(Docs, ExamplesOfTasksParse) {
  const auto blocks = examples("guide/tasks.md");
  EXPECT_GE(blocks.size(), 1u);
  for (const std::string& block : blocks) {
    const auto task = parse_task(block, "guide/tasks.md");
    EXPECT_TRUE(task.ok()) << task.error().message() << "\n" << block;
  }
}

TEST(Docs, ExamplesOfPlansParse) {
  const auto blocks = examples("guide/rehearsal.md");
  EXPECT_GE(blocks.size(), 1u);
  for (const std::string& block : blocks) {
    const auto plan = parse_plan(block, "guide/rehearsal.md");
    EXPECT_TRUE(plan.ok()) << plan.error().message() << "\n" << block;
  }
}

TEST(Docs, ExamplesOfScriptsParse) {
  const auto blocks = examples("guide/script.md");
  EXPECT_GE(blocks.size(), 1u);
  for (const std::string& block : blocks) {
    const auto script = parse_script(block, "guide/script.md");
    EXPECT_TRUE(script.ok()) << script.error().message() << "\n" << block;
  }
}

}  // namespace
}  // namespace palpate
