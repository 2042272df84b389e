#include "verification/label_contact.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>

#include "palpate/surfaces/surfaces.h"
#include "verification/accuracy_random.h"

namespace palpate {
namespace {

TEST(LabelContact, FiguresAreWithinLimits) {
  const auto figures = label_contact_figures({}, {.offsets = 2, .sheets = 6, .presses = 20});
  ASSERT_TRUE(figures.ok());
  for (const Figure& figure : *figures)
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit << ", limit "
                             << figure.limit.value_or(0);
}

TEST(LabelContact, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto figures = label_contact_figures(Progress({}, &stop));
  ASSERT_FALSE(figures.ok());
  EXPECT_EQ(figures.error().kind, ErrorKind::kInterrupted);
}

// number of presses on sheets; overridden by PALPATE_TEST_PRESSES
int sheet_presses(int usually) {
  const char* value = std::getenv("PALPATE_TEST_PRESSES");
  return value != nullptr ? std::atoi(value) : usually;
}

struct PressedSheets {
  label_contact::SheetPresses presses;
  int sheets = 0, leaky = 0, open = 0, open_and_not_leaky = 0;  // `open`: something passed through
};

PressedSheets press_sheets(int voxels, label_contact::Joined joined, int presses) {
  constexpr int kPressesASheet = 20;
  const Eigen::Vector3d spacings_mm[] = {{0.36, 0.36, 0.7}, {0.625, 0.625, 0.9}, {0.28, 0.28, 1}};
  AccuracyRandom random(kLabelContactSeed);
  PressedSheets all;
  for (; all.presses.presses < presses; ++all.sheets) {
    const auto sheet = label_contact::sheet(spacings_mm[all.sheets % 3], random.direction(), voxels, joined);
    const auto pressed = label_contact::press_sheet(
        sheet, kPressesASheet, kLabelContactSeed + static_cast<std::uint64_t>(all.sheets));
    const auto leaks = find_leaks(*label_bricks(sheet.labels), {1});
    EXPECT_TRUE(pressed.ok() && leaks.ok());
    if (!pressed.ok() || !leaks.ok()) return all;
    all.presses.presses += pressed->presses;
    all.presses.detected += pressed->detected;
    all.presses.through += pressed->through;
    const bool open = pressed->through > 0;
    all.leaky += !leaks->empty();
    all.open += open;
    all.open_and_not_leaky += open && leaks->empty();
  }
  std::printf(
      "%d voxels thick, joined by %s: %d presses, %d felt, %d through; of %d sheets %d leaky, %d open\n",
      voxels, joined == label_contact::Joined::kByFaces ? "faces" : "edges", all.presses.presses,
      all.presses.detected, all.presses.through, all.sheets, all.leaky, all.open);
  return all;
}

TEST(Sheets, JoinedByFacesLetNothingThrough) {
  for (const int voxels : {1, 2}) {
    const PressedSheets all = press_sheets(voxels, label_contact::Joined::kByFaces, sheet_presses(600));
    EXPECT_EQ(all.presses.through, 0);
    EXPECT_EQ(all.presses.detected, all.presses.presses);
    EXPECT_EQ(all.leaky, 0);
  }
}

TEST(Sheets, OpenSheetsAreReportedAsLeaks) {
  for (const int voxels : {1, 2}) {
    const PressedSheets all = press_sheets(voxels, label_contact::Joined::kByEdges, sheet_presses(400));
    EXPECT_EQ(all.open_and_not_leaky, 0);
    // the test is not vacuous
    if (voxels == 1) {
      EXPECT_GT(all.open, all.sheets / 2);
    }
  }
}

}  // namespace
}  // namespace palpate
