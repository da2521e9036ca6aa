//! An object drawn on a plain background, cut out of it.

use image::RgbaImage;

/// Largest difference of a colour channel to the background's colour at which a pixel is background.
const TOLERANCE: i32 = 22;

/// Least share of the border that must be background.
const MIN_PLAIN_BORDER: f64 = 0.5;

/// Least share of the picture that the object covers.
const MIN_OBJECT: f64 = 0.003;

/// Sets the alpha of every background pixel to 0 and of all others to 255. Background is what is of the border's usual
/// colour and connected to the border; holes in the object that show the background stay part of it. A picture that
/// came with transparency keeps its own.
///
/// # Errors
/// In words, when the background is not plain or nothing is left.
pub fn cut_out(image: &mut RgbaImage) -> Result<(), String> {
    let (width, height) = image.dimensions();
    let count = f64::from(width) * f64::from(height);
    let transparent = image.pixels().filter(|p| p.0[3] < 128).count() as f64;
    if transparent / count < 0.01 {
        let border: Vec<(u32, u32)> = (0..width)
            .flat_map(|x| [(x, 0), (x, height - 1)])
            .chain((0..height).flat_map(|y| [(0, y), (width - 1, y)]))
            .collect();
        let usual = [0, 1, 2].map(|channel| {
            let mut values: Vec<u8> = border.iter().map(|(x, y)| image.get_pixel(*x, *y).0[channel]).collect();
            values.sort_unstable();
            i32::from(values[values.len() / 2])
        });
        let near = |image: &RgbaImage, x: u32, y: u32| {
            let pixel = image.get_pixel(x, y).0;
            (0..3).all(|c| (i32::from(pixel[c]) - usual[c]).abs() <= TOLERANCE)
        };
        let plain = border.iter().filter(|(x, y)| near(image, *x, *y)).count() as f64 / border.len() as f64;
        if plain < MIN_PLAIN_BORDER {
            return Err(format!("the background is not plain: {:.0} % of the border has one colour", plain * 100.0));
        }
        image.pixels_mut().for_each(|p| p.0[3] = 255);
        let mut open: Vec<(u32, u32)> = border.into_iter().filter(|(x, y)| near(image, *x, *y)).collect();
        for (x, y) in &open {
            image.get_pixel_mut(*x, *y).0[3] = 0;
        }
        while let Some((x, y)) = open.pop() {
            let around = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            for (x, y) in around.into_iter().filter(|(x, y)| *x < width && *y < height) {
                if image.get_pixel(x, y).0[3] != 0 && near(image, x, y) {
                    image.get_pixel_mut(x, y).0[3] = 0;
                    open.push((x, y));
                }
            }
        }
    } else {
        image.pixels_mut().for_each(|p| p.0[3] = if p.0[3] < 128 { 0 } else { 255 });
    }
    let object = image.pixels().filter(|p| p.0[3] > 0).count() as f64;
    if object / count < MIN_OBJECT {
        return Err("there is nothing on the plain background".to_owned());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    fn picture(object: impl Fn(u32, u32) -> bool) -> RgbaImage {
        RgbaImage::from_fn(60, 40, |x, y| {
            // A background that is plain but for noise, as diffusion models draw it.
            let grey = 128 + ((x * 7 + y * 13) % 9) as u8;
            if object(x, y) { Rgba([180, 40, 30, 255]) } else { Rgba([grey, grey, grey, 255]) }
        })
    }

    #[test]
    fn the_object_stays_and_the_background_goes() {
        let object =
            |x: u32, y: u32| (20..40).contains(&x) && (10..30).contains(&y) && !((28..32).contains(&x) && y == 20);
        let mut image = picture(object);
        cut_out(&mut image).unwrap();
        for (x, y, pixel) in image.enumerate_pixels() {
            let hole = (28..32).contains(&x) && y == 20;
            assert_eq!(pixel.0[3] == 255, object(x, y) || hole, "{x} {y}");
        }
    }

    #[test]
    fn an_object_that_leaves_the_frame_is_cut_out_too() {
        let mut image = picture(|x, y| x >= 40 && y >= 10);
        cut_out(&mut image).unwrap();
        assert_eq!((image.get_pixel(59, 39).0[3], image.get_pixel(5, 5).0[3]), (255, 0));
    }

    #[test]
    fn scenes_and_empty_pictures_are_refused() {
        let mut scene = RgbaImage::from_fn(60, 40, |x, y| Rgba([(x * 4) as u8, (y * 6) as u8, 90, 255]));
        assert!(cut_out(&mut scene).unwrap_err().contains("not plain"));
        assert!(cut_out(&mut picture(|_, _| false)).unwrap_err().contains("nothing"));
    }

    #[test]
    fn own_transparency_is_kept() {
        let mut image = RgbaImage::from_fn(20, 20, |x, _| Rgba([200, 100, 50, if x < 10 { 3 } else { 250 }]));
        cut_out(&mut image).unwrap();
        assert_eq!((image.get_pixel(2, 2).0[3], image.get_pixel(15, 2).0[3]), (0, 255));
    }
}
