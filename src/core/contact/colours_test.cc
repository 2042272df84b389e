#include "palpate/contact/colours.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

constexpr Rgb kOfScene{1, 0, 0}, kOfFile{2, 0, 0}, kOfOther{3, 0, 0}, kOfTissue{4, 0, 0};

Model three_tissues() {
  Model model;
  model.segments = {
      {2, "in bone", kOfFile, 0, 2}, {3, "in cartilage", kOfOther, 0, 3}, {9, "nothing's", kOfOther, 0, 9}};
  model.tissue_of_label = {-1, -1, 0, 1, 2};
  model.tissues.resize(3);
  for (Tissue& tissue : model.tissues) tissue.colour = kOfTissue;
  return model;
}

TEST(Colours, ScenePrecedesLabelFilePrecedesTissueDefault) {
  Model model = three_tissues();
  apply_tissue_colours(model.segments, model.tissue_of_label,
                       std::vector<std::optional<Rgb>>{kOfScene, {}, {}});
  EXPECT_EQ(colour_of(model, 2), kOfScene);
  EXPECT_EQ(colour_of(model, 3), kOfOther);
  EXPECT_EQ(colour_of(model, 4), kOfTissue) << "a label without a segment";
  EXPECT_EQ(colour_of(model, 9), kOfOther) << "a segment without a tissue";
  EXPECT_EQ(colour_of(model, 7), Rgb{});
  EXPECT_EQ(colour_of(model, 65535), Rgb{});
}

TEST(Colours, AllLabelsEqualSingleLookups) {
  const Model model = three_tissues();
  const std::vector<Rgb> colours = colours_of_labels(model);
  ASSERT_EQ(colours.size(), 10u);
  for (std::size_t label = 0; label < colours.size(); ++label)
    EXPECT_EQ(colours[label], colour_of(model, static_cast<LabelId>(label))) << label;
}

TEST(Colours, TissueTakesTheColourOfItsFirstStructure) {
  const Model model = three_tissues();
  EXPECT_EQ(colour_of_tissue(model, 0), kOfFile);
  EXPECT_EQ(colour_of_tissue(model, 1), kOfOther);
  EXPECT_EQ(colour_of_tissue(model, 2), kOfTissue);
}

}  // namespace
}  // namespace palpate
