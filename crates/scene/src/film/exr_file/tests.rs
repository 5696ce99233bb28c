use exr::image::FlatSamples;
use exr::meta::attribute::AttributeValue;
use exr::prelude::*;

use super::attributes::text;
use super::{Header, HeaderValue, Layers, WORLD_TO_CAMERA, WORLD_TO_NDC, read, read_header, read_statistics, write};
use crate::film::aov::MISS_DEPTH;
use crate::film::{Aov, AovSums, Background, Film, PixelStats};

fn film() -> Film {
    let mut film = Film::new(40, 30, [4, 3, 24, 25], true);
    for (i, (pixel, aov)) in film.pixels.iter_mut().zip(&mut film.aovs).enumerate() {
        let x = i as f64 * 0.25;
        *pixel = PixelStats {
            samples: 4,
            sum: [x, 2.0 * x, 3.0],
            sum_squared: [x * x, x * x * 4.0, 9.0],
            covered: (i % 5) as u32,
        };
        *aov = AovSums { depth: i as f32, object: i as u32, ..Default::default() };
    }
    film
}

fn written(film: &Film, aovs: &[Aov], header: &Header) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    write(&path, film, aovs, header, None).unwrap();
    (folder, path)
}

#[test]
fn what_is_written_is_read_again_with_its_windows_and_variance() {
    let film = film();
    let (_folder, path) = written(&film, &Aov::DEFAULT, &Header::new());
    let picture = read(&path).unwrap();
    assert_eq!((picture.window, picture.display), ([4, 3, 24, 25], [0, 0, 40, 30]));
    assert_eq!(picture.rgb, film.pixels.iter().map(PixelStats::mean).collect::<Vec<_>>());
    assert_eq!(picture.variance, Some(film.pixels.iter().map(PixelStats::variance_of_mean).collect()));
}

#[test]
fn aovs_are_layers_with_the_usual_letters_and_integers_stay_integers() {
    let film = film();
    let (_folder, path) = written(&film, &Aov::ALL, &Header::new());
    let image = read_first_flat_layer_from_file(&path).unwrap();
    let names = image.layer_data.channel_data.list.iter().map(|c| c.name.to_string()).collect::<Vec<_>>();
    assert_eq!(
        names.join(" "),
        "A B G R albedo.B albedo.G albedo.R balance.V depth.Z direct.B direct.G direct.R indirect.B indirect.G \
         indirect.R material.V normal.X normal.Y normal.Z object.V samples.V variance.B variance.G variance.R"
    );
    let channel = |name| &image.layer_data.channel_data.list[names.iter().position(|n| n == name).unwrap()].sample_data;
    assert_eq!(*channel("samples.V"), FlatSamples::U32(vec![4; 440]));
    assert_eq!(*channel("object.V"), FlatSamples::U32((0..440).collect()));
    let FlatSamples::F32(depth) = channel("depth.Z") else { panic!("depth is not float") };
    assert_eq!(depth[..4], [MISS_DEPTH, 1.0, 1.0, 1.0]);
    let FlatSamples::F32(alpha) = channel("A") else { panic!("alpha is not float") };
    assert_eq!(alpha[..5], [0.0, 0.25, 0.5, 0.75, 1.0]);
}

#[test]
fn where_a_sky_is_shown_the_picture_is_opaque_but_for_pixels_without_paths() {
    let mut film = film();
    film.background = Background::Environment;
    film.pixels[7].samples = 0;
    let alpha = |film: &Film| {
        let (_folder, path) = written(film, &[], &Header::new());
        let image = read_first_rgba_layer_from_file(
            &path,
            |size, _| vec![0.0; size.area()],
            |all, at, (_, _, _, a): (f32, f32, f32, f32)| all[at.y() * 20 + at.x()] = a,
        );
        image.unwrap().layer_data.channel_data.pixels
    };
    let opaque = alpha(&film);
    assert_eq!((opaque[0], opaque[7], opaque[1]), (1.0, 0.0, 1.0));
    film.background = Background::Transparent;
    assert_eq!(alpha(&film)[..5], [0.0, 0.25, 0.5, 0.75, 1.0]);
}

#[test]
fn colours_are_halved_on_demand_and_nothing_else_is() {
    let mut film = film();
    film.pixels[3].sum = [4e9; 3];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let layers = Layers { aovs: &Aov::ALL, half: true, ..Default::default() };
    write(&path, &film, layers, &Header::new(), None).unwrap();
    let image = read_first_flat_layer_from_file(&path).unwrap();
    let halved = image.layer_data.channel_data.list.iter().filter(|c| matches!(c.sample_data, FlatSamples::F16(_)));
    let names = halved.map(|c| c.name.to_string()).collect::<Vec<_>>();
    assert_eq!(
        names.join(" "),
        "A B G R albedo.B albedo.G albedo.R direct.B direct.G direct.R indirect.B indirect.G indirect.R normal.X \
         normal.Y normal.Z"
    );
    let (half, exact) = (read(&path).unwrap().rgb, film.pixels.iter().map(PixelStats::mean).collect::<Vec<_>>());
    // Too bright for 16 bits is as bright as they go.
    assert_eq!(half[3], [65504.0; 3]);
    for (a, b) in half.iter().zip(&exact).skip(4) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= b / 2048.0), "{a:?} for {b:?}");
    }
}

#[test]
fn matrices_stand_where_compositors_look_for_them() {
    let matrix = |first: f32| std::array::from_fn(|i| first + i as f32);
    let header = vec![
        (WORLD_TO_CAMERA.into(), HeaderValue::Matrix(matrix(1.0))),
        (WORLD_TO_NDC.into(), HeaderValue::Matrix(matrix(20.0))),
    ];
    let (_folder, path) = written(&film(), &[], &header);
    let image = read_first_flat_layer_from_file(&path).unwrap();
    let own = &image.layer_data.attributes;
    assert_eq!((own.world_to_camera, own.world_to_normalized_device), (Some(matrix(1.0)), Some(matrix(20.0))));
    assert_eq!(read_header(&path).unwrap(), header);
}

#[test]
fn an_aov_whose_sums_were_not_kept_is_left_out() {
    let film = Film::new(2, 2, [0, 0, 2, 2], false);
    let (_folder, path) = written(&film, &[Aov::Depth, Aov::Balance], &Header::new());
    let image = read_first_flat_layer_from_file(&path).unwrap();
    let names = image.layer_data.channel_data.list.iter().map(|c| c.name.to_string()).collect::<Vec<_>>();
    assert_eq!(names, ["A", "B", "G", "R", "balance.V"]);
}

#[test]
fn header_attributes_hold_text_in_utf8_and_numbers() {
    let header = vec![
        ("bismar.scene".into(), HeaderValue::Text("Küche.glb".into())),
        ("bismar.seed".into(), HeaderValue::Number(7.0)),
    ];
    let (_folder, path) = written(&film(), &[], &header);
    let image = read_first_flat_layer_from_file(&path).unwrap();
    let other = &image.layer_data.attributes.other;
    assert_eq!(other[&text("bismar.scene")], AttributeValue::Text(text("Küche.glb")));
    assert_eq!(other[&text("bismar.seed")], AttributeValue::F64(7.0));
    assert!(read(&path).unwrap().variance.is_none());
    assert_eq!(read_header(&path).unwrap(), header);
    // Bytes that are no UTF-8 are read as Latin-1.
    assert_eq!(super::attributes::string(&Text::new_or_panic("Büro")), "Büro");
}

/// A picture of one colour with these chromaticities, whose data window is at `position` in a display window of 8 x 4.
fn of_color(chromaticities: Option<[(f32, f32); 4]>, position: (i32, i32), size: (usize, usize)) -> Vec<u8> {
    let color = [0.3, 0.5, 0.2];
    let channels = SpecificChannels::rgb(|_| (color[0], color[1], color[2]));
    let attributes = LayerAttributes { layer_position: position.into(), ..LayerAttributes::named("a") };
    let mut image = Image::from_layer(Layer::new(size, attributes, Encoding::UNCOMPRESSED, channels));
    image.attributes.display_window = IntegerBounds::from_dimensions((8, 4));
    image.attributes.chromaticities = chromaticities.map(|[red, green, blue, white]| {
        let [red, green, blue, white] = [red, green, blue, white].map(|(x, y)| Vec2(x, y));
        exr::meta::attribute::Chromaticities { red, green, blue, white }
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

#[test]
fn chromaticities_are_honoured() {
    let ap1 = [(0.713, 0.293), (0.165, 0.830), (0.128, 0.044), (0.32168, 0.33767)];
    // The published matrix from ACEScg to Rec. 709, times the colour.
    for (chromaticities, right) in [(None, [0.3, 0.5, 0.2]), (Some(ap1), [0.18397, 0.52921, 0.15890])] {
        let bytes = of_color(chromaticities, (0, 0), (8, 4));
        let picture = super::picture(&bytes, &|_, _| Ok(())).unwrap();
        assert!(picture.rgb[5].iter().zip(right).all(|(a, b)| (a - b).abs() < 2e-4), "{:?}", picture.rgb[5]);
    }
    // Those that are no colour space's leave the colours as they are.
    let bytes = of_color(Some([(0.3, 0.3); 4]), (0, 0), (8, 4));
    assert_eq!(super::picture(&bytes, &|_, _| Ok(())).unwrap().rgb[0], [0.3, 0.5, 0.2]);
}

#[test]
fn a_panorama_is_the_display_window() {
    for (position, size, lit) in
        [((3, 1), (2, 2), 4), ((-2, -1), (12, 6), 32), ((20, 20), (2, 2), 0), ((0, 0), (8, 4), 32)]
    {
        let bytes = of_color(None, position, size);
        let shown = super::picture(&bytes, &|_, _| Ok(())).unwrap().shown();
        assert_eq!(shown.len(), 32);
        assert_eq!(shown.iter().filter(|p| **p != [0.0; 3]).count(), lit, "{position:?}");
        assert_eq!(shown[8 + 3] != [0.0; 3], lit > 0);
    }
}

#[test]
fn half_floats_and_blenders_layer_names_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("h.exr");
    let channel = |name, x| AnyChannel::new(text(name), FlatSamples::F16(vec![f16::from_f32(x); 6]));
    let channels = [
        channel("視野.Combined.R", 0.5),
        channel("視野.Combined.G", 1.0),
        channel("視野.Combined.B", 2.0),
        channel("視野.Tiefenschärfe.Z", 9.0),
    ];
    let channels = AnyChannels::sort(channels.into_iter().collect());
    Image::from_channels((3, 2), channels).write().to_file(&path).unwrap();
    assert_eq!(read(&path).unwrap().rgb, vec![[0.5, 1.0, 2.0]; 6]);
}

#[test]
fn grey_pictures_are_read_and_what_has_neither_grey_nor_colour_says_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("z.exr");
    let of = |names: &[&str]| {
        let channel = |(name, x): (&&str, f32)| AnyChannel::new(text(name), FlatSamples::F32(vec![x; 4]));
        let channels = AnyChannels::sort(names.iter().zip([0.25, 0.5, 1.0]).map(channel).collect());
        Image::from_channels((2, 2), channels).write().to_file(&path).unwrap();
        read(&path)
    };
    let (grey, cut) = (of(&["Y"]).unwrap(), of(&["Y", "A"]).unwrap());
    assert_eq!((&grey.rgb, &grey.alpha), (&vec![[0.25; 3]; 4], &None));
    assert_eq!((cut.rgb, cut.alpha), (grey.rgb, Some(vec![0.5; 4])));
    for (names, all) in [(&["Z"][..], "Z"), (&["Y", "BY", "RY"], "BY, RY, Y")] {
        let error = of(names).unwrap_err();
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains(&format!("no channels R, G and B but {all}")), "{error}");
    }
}

#[test]
fn inputs_that_are_not_there_or_not_pictures_have_their_own_exit_codes() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(read(&folder.path().join("absent.exr")).unwrap_err().exit_code(), 66);
    assert_eq!(read(folder.path()).unwrap_err().exit_code(), 74);
    let path = folder.path().join("text.exr");
    std::fs::write(&path, "not a picture").unwrap();
    assert_eq!(read(&path).unwrap_err().exit_code(), 65);
}

/// The harness prints panics that the decoder was caught at; they are part of what is tested.
#[test]
fn broken_files_end_in_an_error_or_a_picture_but_never_in_a_panic() {
    let (folder, path) = written(&film(), &Aov::DEFAULT, &Header::new());
    let good = std::fs::read(&path).unwrap();
    let broken = folder.path().join("broken.exr");
    let try_bytes = |bytes: &[u8]| {
        std::fs::write(&broken, bytes).unwrap();
        read(&broken)
    };
    for length in (0..good.len()).step_by(7) {
        assert!(try_bytes(&good[..length]).is_err(), "cut to {length} bytes, and read");
    }
    // The header is the first 800 bytes or so: each byte of it, then a stride through the rest.
    for at in (0..900.min(good.len())).chain((900..good.len()).step_by(41)) {
        for value in [0x00, 0x7f, 0xff, good[at] ^ 0x10] {
            let mut bytes = good.clone();
            bytes[at] = value;
            if let Err(error) = try_bytes(&bytes) {
                assert_eq!(error.exit_code(), 65, "byte {at} = {value}: {error}");
            }
        }
    }
}

#[test]
fn statistics_come_back_to_the_byte_and_the_picture_is_read_as_ever() {
    let film = film();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let header = vec![("bismar.format".into(), HeaderValue::Number(1.0))];
    for length in [0, 1, 4, 70_001] {
        // One part: others crash on a second one whose window is not inside the first one's.
        let bytes: Vec<u8> = (0..length).map(|i: u32| (i.wrapping_mul(i) >> 3) as u8).collect();
        write(&path, &film, &Aov::DEFAULT, &header, Some(&bytes)).unwrap();
        assert_eq!(read_statistics(&path).unwrap(), Some(bytes));
        assert_eq!(read_header(&path).unwrap(), header);
        assert_eq!(read(&path).unwrap().rgb, film.pixels.iter().map(PixelStats::mean).collect::<Vec<_>>());
        let first = read_first_rgba_layer_from_file(&path, |_, _| (), |_, _, _: (f32, f32, f32, f32)| ()).unwrap();
        assert_eq!(first.layer_data.size, Vec2(20, 22));
        let all = read_all_flat_layers_from_file(&path).unwrap();
        assert_eq!(all.layer_data.len(), 1);
    }
    write(&path, &film, &Aov::DEFAULT, &header, None).unwrap();
    assert_eq!(read_statistics(&path).unwrap(), None);
}

#[test]
fn damaged_statistics_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let noise: Vec<u8> = (0..50_000_u32).flat_map(|i| (i as f32).sin().to_le_bytes()).collect();
    write(&path, &film(), &Aov::DEFAULT, &Header::new(), Some(&noise)).unwrap();
    let whole = std::fs::read(&path).unwrap();
    // Every change either goes unnoticed, or is an error: never other bytes, never a panic.
    for i in 0..400 {
        let mut bytes = whole.clone();
        let at = (i * 7919 * 13) % bytes.len();
        bytes[at] ^= 0x55;
        std::fs::write(&path, &bytes).unwrap();
        match read_statistics(&path) {
            Ok(Some(read)) => assert_eq!(read, noise),
            Ok(None) => {}
            Err(e) => assert_eq!(e.exit_code(), 65, "byte {at}: {e}"),
        }
    }
}
