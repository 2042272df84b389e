#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "palpate/base/file.h"

namespace palpate::test {

/// Compares the section between "<!-- NAME begin -->" and "<!-- NAME end -->" in a file of docs/ with the
/// text generated from the declarations. With PALPATE_UPDATE_DOCS in the environment it writes that text
/// instead.
/// @param source_dir  PALPATE_SOURCE_DIR of the test
inline void check_docs_section(const std::string& source_dir, const std::string& file,
                               const std::string& name, const std::string& expected) {
  const std::string path = source_dir + "/docs/" + file;
  auto text = read_file(path);
  ASSERT_TRUE(text.ok()) << text.error().message();
  const std::string begin = "<!-- " + name + " begin -->\n", end = "<!-- " + name + " end -->";
  const std::size_t first = text->find(begin), last = text->find(end);
  ASSERT_NE(first, std::string::npos) << path << " has no " << begin;
  ASSERT_NE(last, std::string::npos) << path << " has no " << end;
  const std::size_t body = first + begin.size();
  if (std::getenv("PALPATE_UPDATE_DOCS") != nullptr) {
    text->replace(body, last - body, expected);
    ASSERT_TRUE(write_file(path, *text).ok());
    return;
  }
  EXPECT_EQ(text->substr(body, last - body), expected)
      << "docs/" << file << " is behind the declarations: run this test with PALPATE_UPDATE_DOCS=1";
}

}  // namespace palpate::test
