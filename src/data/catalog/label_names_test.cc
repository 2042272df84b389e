#include "catalog/label_names.h"

#include <gtest/gtest.h>

#include "base/test_folder.h"

namespace palpate {
namespace {

using test::bytes_of_file;
using test::TemporaryFolder;
using test::write_text;

TEST(MricronNames, BecomeATable) {
  const auto table =
      mricron_names_to_tsv("1 Precentral_L 2001\r\n2\tPrecentral_R\n\n116 Vermis_10 9170", "aal");
  ASSERT_TRUE(table) << table.error().message();
  EXPECT_EQ(*table, "value\tname\n1\tPrecentral_L\n2\tPrecentral_R\n116\tVermis_10\n");
}

TEST(MricronNames, WrongLineIsNamed) {
  for (const char* text : {"1 A\nx B\n", "1 A\n2\n", "1 A\n-2 B\n", "1 A\n70000 B\n", "1 A\n2.5 B\n"}) {
    const auto table = mricron_names_to_tsv(text, "list");
    ASSERT_FALSE(table) << text;
    EXPECT_EQ(table.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(table.error().where, "list:2") << text;
  }
}

TEST(MricronNames, NothingIsAnError) {
  EXPECT_FALSE(mricron_names_to_tsv("", "list").ok());
  EXPECT_FALSE(mricron_names_to_tsv("\n \r\n", "list").ok());
}

TEST(MricronNames, TableIsStoredAndUpdated) {
  const TemporaryFolder folder;
  const auto list = folder / "list.txt", table = folder / "new/folder/names.tsv";
  write_text(list, "1 A\n");
  ASSERT_TRUE(update_names_table(list, table));
  EXPECT_EQ(bytes_of_file(table), "value\tname\n1\tA\n");
  const auto written = std::filesystem::last_write_time(table);
  ASSERT_TRUE(update_names_table(list, table));
  EXPECT_EQ(std::filesystem::last_write_time(table), written);
  write_text(list, "1 B\n");
  ASSERT_TRUE(update_names_table(list, table));
  EXPECT_EQ(bytes_of_file(table), "value\tname\n1\tB\n");
}

TEST(MricronNames, FolderThatCannotBeMade) {
  const TemporaryFolder folder;
  write_text(folder / "list.txt", "1 A\n");
  write_text(folder / "file", "");
  const auto stored = update_names_table(folder / "list.txt", folder / "file/names.tsv");
  ASSERT_FALSE(stored);
  EXPECT_EQ(stored.error().kind, ErrorKind::kOutput);
}

}  // namespace
}  // namespace palpate
