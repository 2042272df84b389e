#include <gtest/gtest.h>

#include <map>

#include "palpate/volume_io/label_tables.h"

namespace palpate {
namespace {

using Names = std::map<int, std::string>;

Names names_of(const std::string& text) {
  const auto labels = parse_label_json(text, "names.json");
  if (!labels) return {{-1, labels.error().message()}};
  Names names;
  for (const NamedLabel& label : *labels) names[label.value] = label.name;
  return names;
}

TEST(LabelJson, ReadsNumbersWithNamesEitherWayRound) {
  const Names expected{{1, "spleen"}, {2, "kidney_right"}};
  EXPECT_EQ(names_of(R"({"1": "spleen", "2": "kidney_right"})"), expected);
  EXPECT_EQ(names_of(R"({"spleen": 1, "kidney_right": 2})"), expected);
  // both versions of nnU-Net's data sets, with a region of two labels
  EXPECT_EQ(names_of(R"({"labels": {"1": "spleen", "2": "kidney_right"}, "name": "x", "numTraining": 3})"),
            expected);
  EXPECT_EQ(
      names_of(R"({"labels": {"spleen": 1, "kidney_right": 2, "all": [1, 2]}, "file_ending": ".nii.gz"})"),
      expected);
  // a class map of TotalSegmentator, under its task
  EXPECT_EQ(names_of(R"({"total": {"1": "spleen", "2": "kidney_right"}})"), expected);
}

// labels that a network learns only in groups
TEST(LabelJson, ReadsRegionsOfNnUNet) {
  const std::string whole = R"({"channel_names": {"0": "MR"}, "labels": {"background": 0, "whole": [1, 2, 3],
      "tumour": [2]}, "regions_class_order": [1, 2], "numTraining": 3, "file_ending": ".nii.gz"})";
  EXPECT_EQ(names_of(whole), (Names{{0, "background"}, {1, "whole"}, {2, "tumour"}, {3, "whole"}}));
  EXPECT_EQ(names_of(R"({"labels": {"background": 0, "whole": [1, 2, 3], "core": [2, 3], "enhancing": 3},
      "regions_class_order": [1, 2, 3]})"),
            (Names{{0, "background"}, {1, "whole"}, {2, "core"}, {3, "enhancing"}}));
  // in another order, predicted values differ from training values
  const std::string swapped = R"({"labels": {"whole": [1, 2], "core": [2]}, "regions_class_order": [2, 1]})";
  EXPECT_NE(names_of(swapped)[-1].find("regions_class_order is not ascending"), std::string::npos);
  EXPECT_EQ(names_of(R"({"labels": {"whole": [1, 2], "core": [2]}})"), (Names{{1, "whole"}, {2, "core"}}));
}

TEST(LabelJson, ReadsTheListsOfNiivue) {
  EXPECT_EQ(names_of(R"({"R": [0, 255], "G": [0, 1], "B": [0, 2], "labels": ["air", "liver"]})"),
            (Names{{0, "air"}, {1, "liver"}}));
  const std::string sparse = R"({"R": [0, 255, 9], "G": [0, 1, 9], "B": [0, 2, 900], "A": [0, 255, 255],
      "I": [0, 5, 70], "labels": ["air", "liver", "spleen"]})";
  EXPECT_EQ(names_of(sparse), (Names{{0, "air"}, {5, "liver"}, {70, "spleen"}}));
  const auto labels = parse_label_json(sparse, "x");
  EXPECT_EQ((*labels)[1].colour, (Rgb{255, 1, 2}));
  EXPECT_FALSE((*labels)[2].colour) << "no colour";
  EXPECT_EQ(names_of(R"({"labels": ["air", "", "liver"]})"), (Names{{0, "air"}, {2, "liver"}}));
}

TEST(LabelJson, ReadsTheSegmentsOfDcmqi) {
  const char* text = R"({
    "ContentCreatorName": "Doe^Jane", "SeriesNumber": "300", "segmentAttributes": [
      [{"labelID": 1, "SegmentLabel": "Liver", "SegmentAlgorithmType": "MANUAL",
        "SegmentedPropertyCategoryCodeSequence": {"CodeMeaning": "Tissue"},
        "SegmentedPropertyTypeCodeSequence": {"CodeValue": "T-62000", "CodeMeaning": "Liver"},
        "recommendedDisplayRGBValue": [221, 130, 101]}],
      [{"labelID": 2, "SegmentedPropertyTypeCodeSequence": {"CodeMeaning": "Kidney"},
        "SegmentedPropertyTypeModifierCodeSequence": {"CodeMeaning": "Left"}}]]})";
  EXPECT_EQ(names_of(text), (Names{{1, "Liver"}, {2, "Left Kidney"}}));
  EXPECT_EQ(parse_label_json(text, "x")->front().colour, (Rgb{221, 130, 101}));
}

TEST(LabelJson, ReadsATerminologyOfSlicers) {
  EXPECT_EQ(names_of(R"({"SegmentationCategoryTypeContextName": "Anatomy", "SegmentationCodes": {"Category": [
      {"CodeMeaning": "Tissue", "Type": [
        {"CodeMeaning": "Artery", "3dSlicerLabel": "artery", "3dSlicerIntegerLabel": 30,
         "recommendedDisplayRGBValue": [216, 101, 79]},
        {"CodeMeaning": "Kidney", "Modifier": [
          {"CodeMeaning": "Right", "3dSlicerLabel": "right kidney", "3dSlicerIntegerLabel": 40},
          {"CodeMeaning": "Left", "3dSlicerIntegerLabel": 41}]},
        {"CodeMeaning": "Without a number"}]}]}})"),
            (Names{{30, "artery"}, {40, "right kidney"}, {41, "Left Kidney"}}));
}

TEST(LabelJson, ReadsListsOfSegments) {
  const char* text =
      R"([{"value": 5, "name": "femur", "color": [0.5, 0, 1.0]}, {"value": 6, "name": "tibia"}])";
  EXPECT_EQ(names_of(text), (Names{{5, "femur"}, {6, "tibia"}}));
  EXPECT_EQ(parse_label_json(text, "x")->front().colour, (Rgb{128, 0, 255}));
  EXPECT_EQ(names_of(R"({"segments": [{"id": "Segment_1", "name": "femur", "labelValue": 3}]})"),
            (Names{{3, "femur"}}));
  EXPECT_EQ(names_of(R"({"labels": [{"id": 3, "name": "femur"}]})"), (Names{{3, "femur"}}));
}

TEST(LabelJson, WhatNamesNothingOrTwiceIsAnError) {
  const std::string deep = std::string(100'000, '[') + std::string(100'000, ']');
  const std::string nested = std::string(40, '[') + "{\"value\": 1, \"name\": \"a\"}" + std::string(40, ']');
  for (const std::string& bad :
       {std::string(), std::string("{"), std::string("1"), std::string("null"), std::string("[]"),
        std::string("{}"), std::string(R"({"Modality": "MR", "EchoTime": 0.03})"),
        std::string(R"({"1": "a"} x)"),
        std::string(R"([{"value": 1, "name": "a"}, {"value": 1, "name": "b"}])"), std::string(R"({"1": ""})"),
        std::string("{\"1\": \"a\\u0007\"}"), std::string("{\"1\": \"\xff\"}"),
        std::string(R"({"70000": "a"})"), std::string(R"({"a": 1.5})"), std::string(R"({"a": -1})"),
        std::string(R"({"a": {"1": "x"}, "b": {"2": "y"}})"), std::string(R"([[[{"name": "a"}]]])"), deep,
        nested}) {
    const auto labels = parse_label_json(bad, "names.json");
    ASSERT_FALSE(labels) << bad.substr(0, 100);
    EXPECT_EQ(labels.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(labels.error().where.substr(0, 10), "names.json") << bad.substr(0, 100);
    EXPECT_FALSE(labels.error().remedy.empty());
  }
}

}  // namespace
}  // namespace palpate
