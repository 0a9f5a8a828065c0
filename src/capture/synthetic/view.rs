//! One camera's renderer: a pose in, a noisy RGB-D frame out, with all memory taken beforehand.

use super::World;
use super::noise_color::{ColorNoise, Developer};
use super::noise_depth::{DepthNoise, DepthOut, counts};
use super::options::{Noise, SyntheticOptions};
use super::random::Random;
use super::raycast::Raycaster;
use super::scene::Scene;
use super::shade::Shaded;
use crate::capture::RgbdFrame;
use crate::geometry::motion::Motion;

/// Names the streams of random numbers, so that none is used twice.
mod stream {
    pub(super) const CAMERA: u64 = 1;
    pub(super) const COLOR: u64 = 2;
    pub(super) const DEPTH: u64 = 3;
}

/// Renders the frames of one camera.
#[derive(Debug)]
pub(super) struct View {
    rays: Raycaster,
    shaded: Shaded,
    developer: Developer,
    noise: Option<(ColorNoise, DepthNoise)>,
    noise_seed: u64,
    index: u64,
    depth_unit_m: f64,
}

impl View {
    pub(super) fn new(scene: &Scene, options: &SyntheticOptions, index: usize) -> Self {
        let SyntheticOptions { noise, seed, noise_seed, .. } = *options;
        let info = &options.cameras[index].info;
        let rays = Raycaster::new(&info.camera, scene.blocks.len());
        let size = (rays.width, rays.height);
        let index = index as u64;
        let noise = match noise {
            Noise::Off => None,
            Noise::D435i { disparity_sigma_px } => {
                let focal_px = info.camera.pinhole().fx_px as f32;
                let depth = DepthNoise::new(size, disparity_sigma_px as f32, focal_px);
                Some((ColorNoise::new(&mut Random::keyed(seed, &[stream::CAMERA, index])), depth))
            }
        };
        let shaded = Shaded::new(size.0 * size.1, scene);
        let (depth_unit_m, noise_seed) = (info.depth_unit_m, noise_seed.unwrap_or(seed));
        Self { rays, shaded, developer: Developer::new(size), noise, noise_seed, index, depth_unit_m }
    }

    /// Overwrites the pictures of `frame` with what the camera sees; `number` picks the noise.
    pub(super) fn render(
        &mut self,
        scene: &Scene,
        (world_from_camera, number): (&Motion, u64),
        frame: &mut RgbdFrame,
    ) {
        let pixels = self.rays.width * self.rays.height;
        (frame.width, frame.height, frame.depth_unit_m) =
            (self.rays.width, self.rays.height, self.depth_unit_m);
        frame.depth_camera = None;
        frame.rgb.resize(3 * pixels, 0);
        frame.depth.resize(pixels, 0);
        self.rays.cast(scene, world_from_camera);
        self.shaded.shade(scene, &self.rays);
        let random = |purpose: u64| Random::keyed(self.noise_seed, &[purpose, self.index, number]);
        match &mut self.noise {
            None => {
                let all = frame.depth.iter_mut().zip(&self.rays.z_m);
                all.for_each(|(out, z_m)| *out = counts(*z_m, self.depth_unit_m));
                self.developer.develop(&mut self.shaded.planes, None, &mut frame.rgb);
            }
            Some((color, depth)) => {
                let out = DepthOut { counts: &mut frame.depth, unit_m: self.depth_unit_m };
                depth.apply((&self.rays, &self.shaded), &mut random(stream::DEPTH), out);
                let camera = (&*color, &mut random(stream::COLOR));
                self.developer.develop(&mut self.shaded.planes, Some(camera), &mut frame.rgb);
            }
        }
    }
}

impl World {
    /// The pose of a camera for a frame set.
    pub(super) fn world_from_camera(&self, camera: usize, frame_set: u64) -> Motion {
        let view = frame_set / self.options.frames_per_view.max(1);
        let world_from_reference = self.trajectory.world_from_reference(view as f64 * self.options.view_step);
        let moves =
            self.options.moves.iter().filter(|moved| moved.camera == camera && moved.at_frame <= frame_set);
        let reference_from_camera = self.options.cameras[camera].reference_from_camera;
        world_from_reference
            * moves.fold(reference_from_camera, |before, moved| before * moved.before_from_after)
    }
}
