#include <itkBinShrinkImageFilter.h>
#include <itkImage.h>
#include <itkMultiThreaderBase.h>
#include <itkRecursiveMultiResolutionPyramidImageFilter.h>

#include <algorithm>

#include "tools/bench/peers/pyramid_peers.h"

namespace isobrick {
namespace {

using ItkImage = itk::Image<float, 3>;

ItkImage::Pointer imageOf(const PeerVolume& volume) {
  const auto image = ItkImage::New();
  image->SetRegions(ItkImage::SizeType{{static_cast<itk::SizeValueType>(volume.x),
                                        static_cast<itk::SizeValueType>(volume.y),
                                        static_cast<itk::SizeValueType>(volume.z)}});
  image->Allocate();
  std::copy(volume.values.begin(), volume.values.end(), image->GetBufferPointer());
  return image;
}

class ItkPyramid : public PeerPyramid {
 public:
  ItkPyramid(bool is_recursive, const PeerVolume& volume, int levels)
      : is_recursive_(is_recursive), volume_(volume), levels_(levels) {}

  void load() override { image_ = imageOf(volume_); }

  PeerPyramidSize make() override {
    size_ = {};
    count(*image_);
    size_.coarser_samples = 0;
    is_recursive_ ? makeRecursively() : shrinkAgainAndAgain();
    return size_;
  }

 private:
  void count(const ItkImage& image) {
    const auto samples = image.GetBufferedRegion().GetNumberOfPixels();
    size_.coarser_samples += samples;
    size_.bytes += samples * sizeof(float);
  }

  void makeRecursively() {
    const auto filter = itk::RecursiveMultiResolutionPyramidImageFilter<ItkImage, ItkImage>::New();
    filter->SetInput(image_);
    filter->SetNumberOfLevels(static_cast<unsigned>(levels_));  // factors 2^(levels - 1), ..., 1
    filter->Update();
    for (int i = 0; i + 1 < levels_; ++i) count(*filter->GetOutput(static_cast<unsigned>(i)));
  }

  void shrinkAgainAndAgain() {
    std::vector<ItkImage::Pointer> made = {image_};
    for (int level = 1; level < levels_; ++level) {
      const auto filter = itk::BinShrinkImageFilter<ItkImage, ItkImage>::New();
      filter->SetInput(made.back());
      filter->SetShrinkFactors(2);
      filter->Update();
      made.push_back(filter->GetOutput());
      made.back()->DisconnectPipeline();
      count(*made.back());
    }
  }

  bool is_recursive_;
  const PeerVolume& volume_;
  int levels_;
  ItkImage::Pointer image_;
  PeerPyramidSize size_;
};

}  // namespace

std::unique_ptr<PeerPyramid> makeItkPyramid(const std::string& row, const PeerVolume& volume,
                                            int levels, int threads) {
  if (row != "itkRecursivePyramid" && row != "itkBinShrink") return nullptr;
  itk::MultiThreaderBase::SetGlobalDefaultNumberOfThreads(static_cast<itk::ThreadIdType>(threads));
  itk::MultiThreaderBase::SetGlobalMaximumNumberOfThreads(static_cast<itk::ThreadIdType>(threads));
  return std::make_unique<ItkPyramid>(row == "itkRecursivePyramid", volume, levels);
}

}  // namespace isobrick
