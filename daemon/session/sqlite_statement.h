#pragma once
// SQLite's prepared statements, as this folder uses them. Private to it.

#include <sqlite3.h>

#include <cstring>
#include <string>
#include <vector>

namespace mesorig::daemon {

// A prepared statement, finalised with the object. SQL that the database does not know leaves it
// empty: Step then answers SQLITE_ERROR.
class Statement {
 public:
  Statement(sqlite3* db, const std::string& sql) {
    sqlite3_prepare_v2(db, sql.c_str(), -1, &statement_, nullptr);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;
  bool ok() const { return statement_ != nullptr; }
  sqlite3_stmt* get() { return statement_; }
  int Step() { return statement_ == nullptr ? SQLITE_ERROR : sqlite3_step(statement_); }

 private:
  sqlite3_stmt* statement_ = nullptr;
};

// Binds one value after the other. (Binding to an empty statement does nothing.)
class Binder {
 public:
  explicit Binder(sqlite3_stmt* statement) : statement_(statement) {}
  Binder& Int(int64_t value) {
    sqlite3_bind_int64(statement_, ++at_, value);
    return *this;
  }
  Binder& Real(double value) {
    sqlite3_bind_double(statement_, ++at_, value);
    return *this;
  }
  Binder& Null() {
    sqlite3_bind_null(statement_, ++at_);
    return *this;
  }
  Binder& Text(const std::string& value) {
    sqlite3_bind_text(statement_, ++at_, value.data(), static_cast<int>(value.size()),
                      SQLITE_TRANSIENT);
    return *this;
  }
  Binder& Doubles(const std::vector<double>& values) {
    // (An empty vector has a null pointer, which would bind NULL.)
    if (values.empty()) {
      sqlite3_bind_zeroblob(statement_, ++at_, 0);
    } else {
      sqlite3_bind_blob(statement_, ++at_, values.data(),
                        static_cast<int>(values.size() * sizeof(double)), SQLITE_TRANSIENT);
    }
    return *this;
  }

 private:
  sqlite3_stmt* statement_;
  int at_ = 0;
};

// Takes one column after the other.
class Columns {
 public:
  explicit Columns(sqlite3_stmt* row) : row_(row) {}
  int64_t Int() { return sqlite3_column_int64(row_, at_++); }
  double Real() { return sqlite3_column_double(row_, at_++); }
  bool IsNull() const { return sqlite3_column_type(row_, at_) == SQLITE_NULL; }
  std::string Text() {
    const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(row_, at_));
    const int size = sqlite3_column_bytes(row_, at_++);
    return text == nullptr ? std::string() : std::string(text, static_cast<size_t>(size));
  }
  std::vector<double> Doubles() {
    const void* blob = sqlite3_column_blob(row_, at_);
    const auto count = static_cast<size_t>(sqlite3_column_bytes(row_, at_++)) / sizeof(double);
    std::vector<double> values(count);
    if (count > 0) std::memcpy(values.data(), blob, count * sizeof(double));
    return values;
  }

 private:
  sqlite3_stmt* row_;
  int at_ = 0;
};

}  // namespace mesorig::daemon
