#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "palpate/scene/named_values.h"
#include "palpate/scene/new_scene.h"
#include "palpate/scene/scene.h"
#include "scene/toml_document.h"
#include "scene/toml_text.h"

namespace palpate {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

LabelMap make_map(const std::vector<std::string>& names) {
  LabelMap map;
  map.layers.emplace_back();
  for (std::size_t i = 0; i < names.size(); ++i) {
    Segment segment;
    segment.id = segment.value = static_cast<LabelId>(3 * i + 2);
    segment.name = names[i];
    map.segments.push_back(segment);
  }
  return map;
}

Scene new_scene(const NewSceneInput& input, const std::filesystem::path& folder = "/cases") {
  const auto text = new_scene_text(input, folder);
  EXPECT_TRUE(text.ok()) << text.error().message();
  auto scene = parse_scene(*text, "new.toml");
  EXPECT_TRUE(scene.ok()) << scene.error().message() << "\n" << *text;
  return *scene;
}

TEST(NewScene, GroupsStructuresBySuggestedPreset) {
  const LabelMap map =
      make_map({"femur", "femoral_cartilage", "stomach", "tibia", "medial_meniscus", "", "implant"});
  const Scene scene = new_scene({.labels = "/cases/a/labels.nrrd", .label_map = &map, .side = Side::kRight});
  ASSERT_EQ(scene.tissues.size(), 6u);
  EXPECT_EQ(scene.side, Side::kRight);
  EXPECT_EQ(scene.labels, "a/labels.nrrd");
  EXPECT_EQ(scene.tissues[0].name, "bone");
  EXPECT_THAT(scene.tissues[0].labels, ElementsAre(LabelReference("femur"), LabelReference("tibia")));
  EXPECT_EQ(scene.tissues[1].name, "cartilage");
  EXPECT_THAT(scene.tissues[1].rests_on, ElementsAre("bone"));
  EXPECT_EQ(scene.tissues[2].name, "meniscus");
  EXPECT_THAT(scene.tissues[2].rests_on, ElementsAre("cartilage"));
  EXPECT_EQ(scene.tissues[3].name, "stomach");
  EXPECT_FALSE(scene.tissues[3].touchable);
  EXPECT_EQ(scene.tissues[4].name, "label 17");
  EXPECT_THAT(scene.tissues[4].labels, ElementsAre(LabelReference(17)));
  EXPECT_EQ(scene.tissues[5].name, "implant");
}

TEST(NewScene, StructuresOfUnknownNamesAreTouchableOnlyIfAskedForAndNoneIsKnown) {
  const LabelMap unknown = make_map({"", "part A", "lateral ventricle"});
  const Scene shown = new_scene({.labels = "/cases/a.nrrd", .label_map = &unknown});
  for (const TissueSettings& tissue : shown.tissues) EXPECT_FALSE(tissue.touchable) << tissue.name;
  const Scene felt = new_scene({.labels = "/cases/a.nrrd", .label_map = &unknown, .touch_unknown = true});
  ASSERT_EQ(felt.tissues.size(), 3u);
  EXPECT_TRUE(felt.tissues[0].touchable);
  EXPECT_EQ(felt.tissues[0].stiffness_N_per_mm, 1);
  EXPECT_TRUE(felt.tissues[1].touchable);
  EXPECT_EQ(felt.tissues[1].name, "part A");
  EXPECT_FALSE(felt.tissues[2].touchable) << "a fluid";

  const LabelMap known = make_map({"part A", "femur"});
  const Scene bone = new_scene({.labels = "/cases/a.nrrd", .label_map = &known, .touch_unknown = true});
  ASSERT_EQ(bone.tissues.size(), 2u);
  EXPECT_TRUE(bone.tissues[0].touchable);
  EXPECT_FALSE(bone.tissues[1].touchable);
}

TEST(NewScene, ReportsTheTermThatSuggestsAPreset) {
  const LabelMap map = make_map({"sterno_thyroid_left", "sterno_thyroid_right", "thyroid_gland",
                                 "kidney_cyst_left", "hip_implant", "stomach", "masseter_left"});
  const auto text = new_scene_text({.labels = "/l.nrrd", .label_map = &map}, "");
  ASSERT_TRUE(text.ok()) << text.error().message();
  EXPECT_THAT(*text,
              HasSubstr("# preset guessed from terms of the names: \"sterno thyroid\" (2), \"masseter\"\n"
                        "labels = [\"sterno_thyroid_left\""));
  EXPECT_THAT(*text,
              HasSubstr("# preset guessed from the name's term \"gland\"\nlabels = [\"thyroid_gland\"]"));
  EXPECT_THAT(*text,
              HasSubstr("name = \"kidney_cyst_left\"\n"
                        "# guessed from its name's term \"cyst\": air or fluid, which does not resist\n"));
  EXPECT_THAT(*text, HasSubstr("name = \"hip_implant\"\n"
                               "# no preset for its name's term \"implant\": add a stiffness"));
  EXPECT_THAT(*text, HasSubstr("name = \"stomach\"\n# its name matches no preset:"));
}

// a long list of terms is wrapped into several comment lines
TEST(NewScene, WrapsTheTermsOfManyNames) {
  std::vector<std::string> names;
  for (const char* name : {"femur", "tibia", "fibula", "patella", "sacrum", "scapula", "clavicle", "humerus",
                           "ulna", "radius", "skull", "mandible", "sternum", "talus", "calcaneus"})
    names.emplace_back(name);
  const LabelMap map = make_map(names);
  const auto text = new_scene_text({.labels = "/l.nrrd", .label_map = &map}, "");
  ASSERT_TRUE(text.ok());
  EXPECT_THAT(*text, HasSubstr(",\n#   \""));
  EXPECT_EQ(new_scene({.labels = "/l.nrrd", .label_map = &map}).tissues.size(), 1u);
}

TEST(NewScene, RestsOnOnlyPresentTissues) {
  const LabelMap map = make_map({"femoral_cartilage", "femur_fat", "lateral_meniscus"});
  const Scene with_cartilage = new_scene({.labels = "/l.nrrd", .label_map = &map});
  EXPECT_TRUE(with_cartilage.tissues[0].rests_on.empty());
  EXPECT_THAT(with_cartilage.tissues[1].rests_on, ElementsAre("cartilage"));
  const LabelMap meniscus = make_map({"femur", "lateral_meniscus"});
  EXPECT_TRUE(new_scene({.labels = "/l.nrrd", .label_map = &meniscus}).tissues[1].rests_on.empty());
}

TEST(NewScene, PutsStructuresTogetherWhenTheyAreTooMany) {
  std::vector<std::string> names{"femur"};
  for (int i = 0; i < 63; ++i) names.push_back("region " + std::to_string(i));
  const LabelMap just_fits = make_map(names);
  EXPECT_EQ(new_scene({.labels = "/l.nrrd", .label_map = &just_fits}).tissues.size(), 64u);
  names.push_back("region 63");
  const LabelMap too_many = make_map(names);
  const Scene scene = new_scene({.labels = "/l.nrrd", .label_map = &too_many});
  ASSERT_EQ(scene.tissues.size(), 2u);
  EXPECT_EQ(scene.tissues[1].labels.size(), 64u);
  EXPECT_FALSE(scene.tissues[1].touchable);
}

TEST(NewScene, WritesPathsRelativeToTheFolderOnlyBelowIt) {
  const LabelMap map = make_map({"femur"});
  const Scene scene = new_scene({.scan = "/cases/./a/../scan.nii.gz",
                                 .labels = "/case/labels.nrrd",
                                 .names = "/cases/..hidden/names.ctbl",
                                 .label_map = &map},
                                "/cases/");
  EXPECT_EQ(scene.scan, "scan.nii.gz");
  EXPECT_EQ(scene.labels, "/case/labels.nrrd");
  EXPECT_EQ(scene.names, "..hidden/names.ctbl");
  const Scene here = new_scene({.labels = "labels.nrrd", .label_map = &map}, "");
  EXPECT_EQ(here.labels, "labels.nrrd");
}

// every structure is in exactly one tissue after a round trip, for any names
TEST(NewScene, RoundTripsAnyNames) {
  const unsigned seed = 20240611;
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const std::vector<std::string> parts{"\"",
                                       "\\",
                                       "\n",
                                       "\r",
                                       "\t",
                                       "'",
                                       "#",
                                       "]",
                                       "[[tissue]]",
                                       std::string(1, '\0'),
                                       "\x7f",
                                       "\x1b",
                                       "é",
                                       "骨",
                                       "😀",
                                       "\xff",
                                       "\xc0\x80",
                                       "\xed\xa0\x80",
                                       "femur",
                                       "bone",
                                       " ",
                                       "_",
                                       "a",
                                       "\"\"\"",
                                       "\\u0041",
                                       "\xe2\x80\xa8",
                                       "\xef\xbf\xbf",
                                       "."};
  for (int round = 0; round < 300; ++round) {
    std::vector<std::string> names(1 + random() % 80);
    for (std::string& name : names)
      for (auto length = random() % 5; length > 0; --length) name += parts[random() % parts.size()];
    std::string file = "/cases/";
    for (int i = 0; i < 4; ++i) {
      const std::string& part = parts[random() % parts.size()];
      if (is_utf8(part) && part != std::string(1, '\0')) file += part;
    }
    const LabelMap map = make_map(names);
    const Scene scene = new_scene({.labels = file + "x", .label_map = &map, .title = "\"\\\n# [x]"});
    EXPECT_EQ(scene.title, "\"\\\n# [x]");
    EXPECT_EQ("/cases" / *scene.labels, std::filesystem::path(file + "x").lexically_normal());
    const auto ids = resolve_labels(scene, map);
    ASSERT_TRUE(ids.ok()) << ids.error().message();
    std::multiset<int> found, expected;
    for (const auto& tissue : *ids) found.insert(tissue.begin(), tissue.end());
    for (const Segment& segment : map.segments) expected.insert(segment.id);
    ASSERT_EQ(found, expected);
  }
}

LabelMap map_with_spacing(double x, double y, double z) {
  LabelMap map = make_map({"femur"});
  GridGeometry grid;
  grid.dims = {2, 2, 2};
  grid.spacing_mm = {x, y, z};
  map.layers[0] = Volume<LabelId>(grid);
  return map;
}

// sigma: at least 1 mm, at least the largest voxel spacing, never above the key's range
TEST(NewScene, SmoothsAsWideAsTheVoxels) {
  const auto sigma_for = [](double x, double y, double z) {
    const LabelMap map = map_with_spacing(x, y, z);
    return new_scene({.labels = "/l.nrrd", .label_map = &map}).preparation.sigma_mm;
  };
  EXPECT_EQ(sigma_for(0.28, 0.28, 0.3), 1.0);
  EXPECT_EQ(sigma_for(0.28, 0.28, 1.0), 1.0);
  EXPECT_EQ(sigma_for(0.5, 1.0 + 1e-9, 0.5), 1.0) << "rounding is no reason";
  EXPECT_EQ(sigma_for(0.5, 0.5, 1.21), 1.3);
  EXPECT_EQ(sigma_for(3, 0.5, 0.5), 3.0);
  EXPECT_EQ(sigma_for(0.5, 0.5, 25), 10.0);
}

TEST(NewScene, SmoothsByTheGridsThatTheFieldIsMadeFrom) {
  const LabelMap fine = map_with_spacing(0.5, 0.5, 0.5), thick = map_with_spacing(0.5, 0.5, 4);
  GridGeometry grid;
  grid.dims = {2, 1, 1};
  grid.spacing_mm = {2, 2, 2};
  const Volume<float> scan(grid, {1, 2});
  EXPECT_EQ(new_scene({.scan = "/s.nii", .scan_volume = &scan}).preparation.sigma_mm, 2.0);
  const auto beside = [&](const LabelMap& map) {
    return new_scene({.scan = "/s.nii", .labels = "/l.nrrd", .label_map = &map, .scan_volume = &scan})
        .preparation.sigma_mm;
  };
  EXPECT_EQ(beside(fine), 1.0);
  EXPECT_EQ(beside(thick), 4.0);
}

TEST(NewScene, ExplainsAWideSigma) {
  const LabelMap thick = map_with_spacing(0.5, 0.5, 3), fine = map_with_spacing(0.5, 0.5, 0.5);
  EXPECT_THAT(*new_scene_text({.labels = "/l.nrrd", .label_map = &thick}, "/"),
              HasSubstr("# voxels are up to 3 mm wide"));
  EXPECT_THAT(*new_scene_text({.labels = "/l.nrrd", .label_map = &fine}, "/"), Not(HasSubstr("mm wide")));
}

TEST(NewScene, WritesEverySide) {
  const LabelMap map = make_map({"femur"});
  for (const Side side : {Side::kUnknown, Side::kLeft, Side::kRight, Side::kBoth})
    EXPECT_EQ(new_scene({.labels = "/l.nrrd", .label_map = &map, .side = side}).side, side);
}

TEST(NewScene, WritesEveryModality) {
  const LabelMap map = make_map({"femur"});
  for (const auto& [modality, name] : kModalities)
    EXPECT_EQ(new_scene({.labels = "/l.nrrd", .label_map = &map, .modality = modality}).modality, modality)
        << name;
}

TEST(NewScene, SoftTissueYieldsUnlessLayersAreAskedFor) {
  const LabelMap map = make_map({"femur", "vastus_lateralis_muscle"}), hard = make_map({"femur", "x"});
  const NewSceneInput elastic{.labels = "/l.nrrd", .label_map = &map};
  NewSceneInput layers = elastic;
  layers.law = TissueLaw::kLayers;
  EXPECT_EQ(new_scene(layers).deformation.law, TissueLaw::kLayers);
  EXPECT_EQ(new_scene({.labels = "/l.nrrd", .label_map = &hard}).deformation.law, TissueLaw::kLayers)
      << "nothing in it could yield";
  EXPECT_THAT(*new_scene_text(layers, "/"), testing::Not(HasSubstr("yielding")));
  const Scene scene = new_scene(elastic);
  EXPECT_EQ(scene.deformation.law, TissueLaw::kElastic);
  EXPECT_FALSE(scene.deformation.cell_mm);
  EXPECT_FALSE(scene.tissues[0].elastic.has_value());
  EXPECT_EQ(scene.tissues[1].elastic, (ElasticConstants{14, 0.45}));
  const std::string text = *new_scene_text(elastic, "/");
  EXPECT_THAT(text, HasSubstr("friction 0.2, rigid"));
  EXPECT_THAT(text, HasSubstr("friction 0.1, E 14 kPa"));
}

TEST(NewScene, IsDeterministic) {
  const LabelMap map = make_map({"femur", "x", "y", "patellar_cartilage"});
  const NewSceneInput input{.labels = "/l.nrrd", .label_map = &map};
  EXPECT_EQ(*new_scene_text(input, "/"), *new_scene_text(input, "/"));
}

Volume<float> scan_of(const std::vector<float>& values) {
  GridGeometry grid;
  grid.dims = {static_cast<int>(values.size()), 1, 1};
  return {grid, values};
}

// two separated classes: the threshold lies between them, at any scale and offset
TEST(NewScene, AScanAloneIsPartedBetweenItsTwoClasses) {
  for (const float scale : {0.001f, 1.f, 500.f}) {
    for (const float offset : {-1000.f, 0.f, 3000.f}) {
      std::vector<float> values;
      for (int i = 0; i < 100; ++i) values.push_back(offset * scale + scale * static_cast<float>(i % 10));
      for (int i = 0; i < 40; ++i)
        values.push_back(offset * scale + scale * static_cast<float>(100 + i % 10));
      const Volume<float> scan = scan_of(values);
      const Scene scene = new_scene({.scan = "/s.nii", .scan_volume = &scan});
      ASSERT_EQ(scene.tissues.size(), 1u);
      const auto [low, high] = *scene.tissues[0].threshold;
      EXPECT_GE(low, scale * (offset + 8.5)) << scale << " " << offset;
      EXPECT_LE(low, scale * (offset + 100)) << scale << " " << offset;
      EXPECT_GT(high, low);
      EXPECT_LE(high, scale * (offset + 105)) << scale << " " << offset;
      EXPECT_TRUE(scene.tissues[0].touchable);
    }
  }
}

TEST(NewScene, IgnoresValuesThatAreNotFinite) {
  const Volume<float> scan = scan_of({NAN, 1, 1, 1, INFINITY, 5, 5, -INFINITY});
  const auto threshold = *new_scene({.scan = "/s.nii", .scan_volume = &scan}).tissues[0].threshold;
  EXPECT_GT(threshold[0], 1);
  EXPECT_LT(threshold[1], 5);
}

TEST(NewScene, RejectsUnusableInput) {
  const LabelMap map = make_map({"femur"}), empty = make_map({});
  const Volume<float> flat = scan_of({3, 3, 3}), none = scan_of({NAN, NAN}),
                      huge = scan_of({0, 1e30f, 1e30f});
  EXPECT_FALSE(new_scene_text({}, "/").ok());
  EXPECT_FALSE(new_scene_text({.labels = "/l.nrrd", .label_map = &empty}, "/").ok());
  EXPECT_FALSE(new_scene_text({.labels = "/\xff.nrrd", .label_map = &map}, "/").ok());
  EXPECT_FALSE(new_scene_text({.labels = "/l.nrrd", .label_map = &map, .title = "\xff"}, "/").ok());
  for (const auto* scan : {&flat, &none, &huge})
    EXPECT_FALSE(new_scene_text({.scan = "/s.nii", .scan_volume = scan}, "/").ok());
}

TEST(TomlText, EscapesControlCharacters) {
  EXPECT_EQ(toml_string("a\"b\\c\nd\x7f"), "\"a\\\"b\\\\c\\u000Ad\\u007F\"");
  for (int c = 0; c < 128; ++c) {
    const std::string text(1, static_cast<char>(c));
    const auto table = parse_toml("a = " + toml_string(text), 100, "t");
    ASSERT_TRUE(table.ok()) << c << table.error().message();
    EXPECT_EQ(*table->find("a")->as<std::string>(), text);
  }
}

// by definition: decodes every sequence of up to four bytes from a set with all boundary values
TEST(TomlText, KnowsWellFormedUtf8) {
  const std::vector<int> bytes{0x00, 0x7F, 0x80, 0x8F, 0x90, 0x9F, 0xA0, 0xBF, 0xC0, 0xC1, 0xC2,
                               0xDF, 0xE0, 0xE1, 0xED, 0xEE, 0xEF, 0xF0, 0xF1, 0xF4, 0xF5, 0xFF};
  const auto reference = [](const std::vector<int>& s) {
    std::size_t i = 0;
    while (i < s.size()) {
      const int n = s[i] < 0x80         ? 1
                    : (s[i] >> 5) == 6  ? 2
                    : (s[i] >> 4) == 14 ? 3
                    : (s[i] >> 3) == 30 ? 4
                                        : 0;
      if (n == 0 || i + n > s.size()) return false;
      int code = n == 1 ? s[i] : s[i] & (0x7F >> n);
      for (int j = 1; j < n; ++j) {
        if ((s[i + j] >> 6) != 2) return false;
        code = (code << 6) | (s[i + j] & 0x3F);
      }
      const int smallest[] = {0, 0, 0x80, 0x800, 0x10000};
      if (code < smallest[n] || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF)) return false;
      i += n;
    }
    return true;
  };
  const std::size_t n = bytes.size();
  for (std::size_t length = 1, total = n; length <= 4; ++length, total *= n) {
    for (std::size_t k = 0; k < total; ++k) {
      std::vector<int> sequence;
      std::string text;
      for (std::size_t j = 0, rest = k; j < length; ++j, rest /= n) {
        sequence.push_back(bytes[rest % n]);
        text += static_cast<char>(sequence.back());
      }
      ASSERT_EQ(is_utf8(text), reference(sequence)) << testing::PrintToString(sequence);
    }
  }
}

}  // namespace
}  // namespace palpate
