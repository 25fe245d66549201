mod build;
mod faults;
mod pixels;
mod places;
mod segments;
mod series;
