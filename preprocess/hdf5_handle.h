// Identifiers of the HDF5 library. Private to the files that read and write HDF5.
#pragma once

#include <hdf5.h>

#include <mutex>
#include <utility>

namespace isobrick {

// The library has one state for the whole process, and prints a stack of calls for everything that
// fails, by a setting of each thread: no call to it is made without this, which keeps it silent.
class Hdf5Call {
 public:
  Hdf5Call() : lock_(mutex()) {
    H5Eget_auto2(H5E_DEFAULT, &print_, &print_data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~Hdf5Call() { H5Eset_auto2(H5E_DEFAULT, print_, print_data_); }
  Hdf5Call(const Hdf5Call&) = delete;
  Hdf5Call& operator=(const Hdf5Call&) = delete;

 private:
  static std::recursive_mutex& mutex() {
    static std::recursive_mutex mutex;
    return mutex;
  }

  std::lock_guard<std::recursive_mutex> lock_;
  H5E_auto2_t print_ = nullptr;
  void* print_data_ = nullptr;
};

// An identifier of any kind, closed at the end.
class Hdf5Handle {
 public:
  using Close = herr_t (*)(hid_t);
  Hdf5Handle() = default;
  Hdf5Handle(hid_t id, Close how) : id_(id), close_(how) {}
  Hdf5Handle(Hdf5Handle&& other) noexcept { swap(other); }
  Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
    Hdf5Handle moved(std::move(other));
    swap(moved);
    return *this;
  }
  ~Hdf5Handle() { close(); }

  hid_t id() const { return id_; }
  bool isValid() const { return id_ >= 0; }
  // False if that failed: of a file, if its last bytes could not be written.
  bool close() {
    if (id_ < 0) return true;
    const Hdf5Call call;
    return close_(std::exchange(id_, H5I_INVALID_HID)) >= 0;
  }

 private:
  void swap(Hdf5Handle& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
  }

  hid_t id_ = H5I_INVALID_HID;
  Close close_ = nullptr;
};

}  // namespace isobrick
