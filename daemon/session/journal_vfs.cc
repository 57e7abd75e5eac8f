#include "daemon/session/journal_vfs.h"

#include <sqlite3.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <new>

#include "protocol/base/status.h"

namespace mesorig::daemon {
namespace {

// A file of ours; the real one lies behind it in the same allocation, as SQLite's VFS shims do.
struct File {
  sqlite3_file base;   // first: SQLite knows only this
  DiskFaults* faults;  // null: a temporary file
  std::filesystem::path* path;
  sqlite3_file* real() { return reinterpret_cast<sqlite3_file*>(this + 1); }
};

File& Of(sqlite3_file* file) { return *reinterpret_cast<File*>(file); }
const sqlite3_io_methods& Real(sqlite3_file* file) { return *Of(file).real()->pMethods; }

int CodeOf(int error, int otherwise) {
  if (error == ENOSPC || error == EDQUOT || error == EFBIG) return SQLITE_FULL;
  return error == EBUSY ? SQLITE_BUSY : otherwise;
}

int Close(sqlite3_file* file) {
  const int code = Real(file).xClose(Of(file).real());
  delete Of(file).path;
  return code;
}
int Read(sqlite3_file* file, void* bytes, int size, sqlite3_int64 offset) {
  return Real(file).xRead(Of(file).real(), bytes, size, offset);
}
int Write(sqlite3_file* file, const void* bytes, int size, sqlite3_int64 offset) {
  uint64_t torn = 0;
  const DiskAccess access{DiskOperation::kWrite, *Of(file).path, static_cast<uint64_t>(offset),
                          static_cast<uint64_t>(size)};
  DiskFaults* const faults = Of(file).faults;
  const int error = faults == nullptr ? 0 : faults->Before(access, &torn);
  if (error == 0) return Real(file).xWrite(Of(file).real(), bytes, size, offset);
  if (torn > 0) {
    const int part = static_cast<int>(std::min<uint64_t>(torn, static_cast<uint64_t>(size)));
    (void)Real(file).xWrite(Of(file).real(), bytes, part, offset);
  }
  return CodeOf(error, SQLITE_IOERR_WRITE);
}
int Truncate(sqlite3_file* file, sqlite3_int64 size) {
  const int error = AskDisk(Of(file).faults, DiskOperation::kTruncate, *Of(file).path,
                            static_cast<uint64_t>(size));
  return error == 0 ? Real(file).xTruncate(Of(file).real(), size)
                    : CodeOf(error, SQLITE_IOERR_TRUNCATE);
}
int Sync(sqlite3_file* file, int flags) {
  const int error = AskDisk(Of(file).faults, DiskOperation::kSync, *Of(file).path);
  return error == 0 ? Real(file).xSync(Of(file).real(), flags) : CodeOf(error, SQLITE_IOERR_FSYNC);
}
int FileSize(sqlite3_file* file, sqlite3_int64* size) {
  return Real(file).xFileSize(Of(file).real(), size);
}
int Lock(sqlite3_file* file, int level) { return Real(file).xLock(Of(file).real(), level); }
int Unlock(sqlite3_file* file, int level) { return Real(file).xUnlock(Of(file).real(), level); }
int CheckReservedLock(sqlite3_file* file, int* result) {
  return Real(file).xCheckReservedLock(Of(file).real(), result);
}
int FileControl(sqlite3_file* file, int operation, void* argument) {
  return Real(file).xFileControl(Of(file).real(), operation, argument);
}
int SectorSize(sqlite3_file* file) { return Real(file).xSectorSize(Of(file).real()); }
int DeviceCharacteristics(sqlite3_file* file) {
  return Real(file).xDeviceCharacteristics(Of(file).real());
}
int ShmMap(sqlite3_file* file, int page, int size, int extend, void volatile** memory) {
  return Real(file).xShmMap(Of(file).real(), page, size, extend, memory);
}
int ShmLock(sqlite3_file* file, int offset, int count, int flags) {
  return Real(file).xShmLock(Of(file).real(), offset, count, flags);
}
void ShmBarrier(sqlite3_file* file) { Real(file).xShmBarrier(Of(file).real()); }
int ShmUnmap(sqlite3_file* file, int remove) {
  return Real(file).xShmUnmap(Of(file).real(), remove);
}

// Version 2: SQLite then maps no file into memory, and every write comes by.
const sqlite3_io_methods kMethods = {2,
                                     Close,
                                     Read,
                                     Write,
                                     Truncate,
                                     Sync,
                                     FileSize,
                                     Lock,
                                     Unlock,
                                     CheckReservedLock,
                                     FileControl,
                                     SectorSize,
                                     DeviceCharacteristics,
                                     ShmMap,
                                     ShmLock,
                                     ShmBarrier,
                                     ShmUnmap,
                                     nullptr,
                                     nullptr};

sqlite3_vfs* RealVfs() { return sqlite3_vfs_find(nullptr); }
DiskFaults* FaultsOf(sqlite3_vfs* vfs) { return static_cast<DiskFaults*>(vfs->pAppData); }

int Open(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* out_flags) {
  File& ours = Of(file);
  ours.base.pMethods = nullptr;  // until it is open there is nothing to close
  const std::filesystem::path path(name == nullptr ? "" : name);
  DiskFaults* const faults = name == nullptr ? nullptr : FaultsOf(vfs);
  std::error_code ignored;
  if ((flags & SQLITE_OPEN_CREATE) != 0 && !std::filesystem::exists(path, ignored) &&
      AskDisk(faults, DiskOperation::kCreate, path) != 0) {
    return SQLITE_CANTOPEN;
  }
  const int code = RealVfs()->xOpen(RealVfs(), name, ours.real(), flags, out_flags);
  if (code != SQLITE_OK) return code;
  ours.faults = faults;
  ours.path = new std::filesystem::path(path);
  ours.base.pMethods = &kMethods;
  return SQLITE_OK;
}
int Delete(sqlite3_vfs* vfs, const char* name, int sync) {
  const int error = AskDisk(FaultsOf(vfs), DiskOperation::kRemove, name);
  return error == 0 ? RealVfs()->xDelete(RealVfs(), name, sync)
                    : CodeOf(error, SQLITE_IOERR_DELETE);
}

}  // namespace

JournalVfs::JournalVfs() = default;

std::unique_ptr<JournalVfs> JournalVfs::Register(DiskFaults& faults) {
  static std::atomic<unsigned> count{0};
  sqlite3_vfs* const real = RealVfs();
  if (real == nullptr) return nullptr;
  std::unique_ptr<JournalVfs> ours(new JournalVfs);
  ours->name_ = fmt::format("mesorig-journal-{}", count++);
  ours->vfs_ = std::make_unique<sqlite3_vfs>(*real);  // what is not replaced goes to the real one
  ours->vfs_->pNext = nullptr;
  ours->vfs_->zName = ours->name_.c_str();
  ours->vfs_->pAppData = &faults;
  ours->vfs_->szOsFile = static_cast<int>(sizeof(File)) + real->szOsFile;
  ours->vfs_->xOpen = Open;
  ours->vfs_->xDelete = Delete;
  if (sqlite3_vfs_register(ours->vfs_.get(), 0) != SQLITE_OK) return nullptr;
  return ours;
}

JournalVfs::~JournalVfs() { sqlite3_vfs_unregister(vfs_.get()); }

}  // namespace mesorig::daemon
