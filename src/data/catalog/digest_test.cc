#include "catalog/digest.h"

#include <gtest/gtest.h>

#include "base/test_folder.h"

namespace palpate {
namespace {

using test::TemporaryFolder;
using test::write_text;

// NIST's examples for SHA-256, and object ids printed by `git hash-object`
TEST(Digest, KnownValues) {
  const TemporaryFolder folder;
  write_text(folder / "empty", "");
  write_text(folder / "abc", "abc");
  EXPECT_EQ(*sha256_of_file(folder / "empty"),
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(*sha256_of_file(folder / "abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(*git_blob_of_file(folder / "empty"), "e69de29bb2d1d6434b8b29ae775ad8c2e48c5391");
  EXPECT_EQ(*git_blob_of_file(folder / "abc"), "f2ba8f84ab5c1bce84a7b441cb1959cfc7093b7f");
}

TEST(Digest, LongerThanOneBuffer) {
  const TemporaryFolder folder;
  // NIST's long example: one million times 'a'
  write_text(folder / "long", std::string(1000000, 'a'));
  EXPECT_EQ(*sha256_of_file(folder / "long"),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Digest, MissingFileAndFolder) {
  const TemporaryFolder folder;
  EXPECT_EQ(sha256_of_file(folder / "absent").error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(git_blob_of_file(folder / "absent").error().kind, ErrorKind::kBadInput);
  EXPECT_FALSE(sha256_of_file(folder.path()).ok());
}

}  // namespace
}  // namespace palpate
