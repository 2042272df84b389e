#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "palpate/scene/scene.h"

namespace palpate {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

LabelMap make_map(const std::vector<std::pair<int, std::string>>& structures) {
  LabelMap map;
  map.layers.emplace_back();
  for (const auto& [id, name] : structures) {
    Segment segment;
    segment.id = segment.value = static_cast<LabelId>(id);
    segment.name = name;
    map.segments.push_back(segment);
  }
  return map;
}

Scene scene_of(const std::string& text) {
  auto scene = parse_scene(text, "scene.toml");
  EXPECT_TRUE(scene.ok()) << scene.error().message();
  return *scene;
}

TEST(ResolveLabels, TakesNumbersNamesAndEverySegmentOfAName) {
  const LabelMap map = make_map({{2, "rib"}, {3, ""}, {7, "femur"}, {9, "rib"}, {300, "#3"}});
  const Scene scene = scene_of(
      "[[tissue]]\nname = 'a'\nlabels = ['rib', 'femur']\n[[tissue]]\nname = 'b'\nlabels = [3]\n"
      "[[tissue]]\nname = 'c'\nthreshold = [1, 2]\n");
  const auto ids = resolve_labels(scene, map);
  ASSERT_TRUE(ids.ok()) << ids.error().message();
  EXPECT_THAT(*ids, ElementsAre(ElementsAre(2, 7, 9), ElementsAre(3), IsEmpty()));
}

TEST(ResolveLabels, AbsentLabelIsAnErrorWithItsLine) {
  const LabelMap map = make_map({{1, "femur"}, {2, "tibia"}});
  for (const char* label : {"'Femur'", "3", "'femur '"}) {
    const auto ids = resolve_labels(
        scene_of(
            std::string("[[tissue]]\nname = 'x'\nlabels = [2]\n\n[[tissue]]\nname = 'a'\nlabels = [1,\n") +
            label + "]\n"),
        map);
    ASSERT_FALSE(ids.ok());
    EXPECT_EQ(ids.error().where, "scene.toml:8");
    EXPECT_THAT(ids.error().what, HasSubstr("which the label map lacks"));
    EXPECT_THAT(ids.error().remedy, HasSubstr("1 femur, 2 tibia"));
  }
}

TEST(ResolveLabels, SuggestsTheNameThatIsNear) {
  const LabelMap map = make_map({{1, "femur"}, {2, "tibia"}});
  const auto remedy_of = [&](const std::string& label) {
    const auto ids = resolve_labels(scene_of("[[tissue]]\nname = 'a'\nlabels = ['" + label + "']\n"), map);
    return ids.ok() ? "" : ids.error().remedy;
  };
  EXPECT_THAT(remedy_of("tibea"), HasSubstr("did you mean \"tibia\"? the label map has 1 femur"));
  EXPECT_THAT(remedy_of("Tibia"), HasSubstr("did you mean \"tibia\"?"));
  EXPECT_THAT(remedy_of("spleen"), testing::StartsWith("the label map has 1 femur"));
}

TEST(ResolveLabels, OptionalLabelsDropOut) {
  const LabelMap map = make_map({{1, "femur"}});
  const auto ids =
      resolve_labels(scene_of("[[tissue]]\nname = 'a'\nlabels = ['femur', 'soleus', 5]\noptional = true\n"
                              "[[tissue]]\nname = 'b'\nlabels = ['gracilis']\noptional = true\n"),
                     map);
  ASSERT_TRUE(ids.ok()) << ids.error().message();
  EXPECT_THAT(*ids, ElementsAre(ElementsAre(1), IsEmpty()));
}

TEST(ResolveLabels, ALabelClaimedTwiceIsAnError) {
  const LabelMap map = make_map({{1, "femur"}, {2, "tibia"}});
  const auto twice = resolve_labels(
      scene_of("[[tissue]]\nname = 'a'\nlabels = ['femur']\n[[tissue]]\nname = 'b'\nlabels = [2, 1]\n"), map);
  ASSERT_FALSE(twice.ok());
  EXPECT_EQ(twice.error().where, "scene.toml:6");
  EXPECT_THAT(twice.error().what, HasSubstr("claims label 1, which \"a\" (line 1) already has"));
  EXPECT_FALSE(resolve_labels(scene_of("[[tissue]]\nname = 'a'\nlabels = ['femur', 1]\n"), map).ok());
}

TEST(ResolveNoGo, AStructureMayBeInSeveralRegionsAndHasToBeThere) {
  const LabelMap map = make_map({{1, "femur"}, {2, "tibia"}, {5, "nerve"}, {6, "nerve"}});
  const std::string tissue = "[[tissue]]\nname = 'a'\nlabels = ['femur']\n";
  const auto ids = resolve_no_go(scene_of(tissue + "[[no_go]]\nname = 'n'\nstructures = ['nerve', 2, 6]\n"
                                                   "[[no_go]]\nname = 'b'\ncentre = [0, 0, 0]\nradius = 1\n"
                                                   "[[no_go]]\nname = 't'\nstructures = [2]\n"),
                                 map);
  ASSERT_TRUE(ids.ok()) << ids.error().message();
  EXPECT_THAT(*ids, ElementsAre(ElementsAre(2, 5, 6), IsEmpty(), ElementsAre(2)));
  const auto absent =
      resolve_no_go(scene_of(tissue + "[[no_go]]\nname = 'n'\nstructures = ['nerfe']\n"), map);
  ASSERT_FALSE(absent.ok());
  EXPECT_EQ(absent.error().where, "scene.toml:6");
  EXPECT_THAT(absent.error().what, HasSubstr("no-go region \"n\" has the label"));
  EXPECT_THAT(absent.error().remedy, HasSubstr("did you mean \"nerve\"?"));
}

}  // namespace
}  // namespace palpate
