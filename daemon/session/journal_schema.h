#pragma once
// The tables of `journal.sqlite` (docs/files.md), and how an older journal becomes today's.

struct sqlite3;

namespace mesorig::daemon {

inline constexpr int kJournalApplicationId = 0x4D534A31;  // "MSJ1"
inline constexpr int kJournalVersion = 3;

// -1: cannot be read.
int JournalVersionOf(sqlite3* db);
// Makes the tables in an empty database; brings one of version 1 or 2 to kJournalVersion and leaves
// every other alone. Each in one transaction: all of it or nothing. Returns SQLite's
// code; after an error the connection is to be closed.
int CreateJournalTables(sqlite3* db);
int MigrateJournal(sqlite3* db);

}  // namespace mesorig::daemon
