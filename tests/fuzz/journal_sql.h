#pragma once
// Statements on a journal as a damaged program or a curious person would run them. They cannot
// reach another file and end soon.

#include <sqlite3.h>

#include <filesystem>
#include <string>
#include <string_view>

#include "protocol/base/check.h"

namespace mesorig::fuzz {

inline void RunSql(const std::filesystem::path& journal, std::string_view statements) {
  sqlite3* db = nullptr;
  MESORIG_CHECK(::sqlite3_open(journal.c_str(), &db) == SQLITE_OK);
  ::sqlite3_limit(db, SQLITE_LIMIT_ATTACHED, 0);  // VACUUM INTO attaches too
  ::sqlite3_limit(db, SQLITE_LIMIT_LENGTH, 1 << 20);
  int steps = 0;
  ::sqlite3_progress_handler(
      db, 1000, [](void* count) { return ++*static_cast<int*>(count) > 200 ? 1 : 0; }, &steps);
  ::sqlite3_exec(db, std::string(statements).c_str(), nullptr, nullptr, nullptr);
  ::sqlite3_close(db);
}

}  // namespace mesorig::fuzz
