//! Grasps: a hand with objects between its fingers.

use god::Memory;
use hil_experiment::grasp;
use hil_experiment::typist::Typist;
use hil_world::hand::Hand;
use hil_world::hand::scene::{Scene, gap};
use hil_world::plant::Model;

const BALL: &str = include_str!("../../hil-sim/grasps/ball.toml");

fn in_scene(scene: Scene) -> Typist {
    let mut hand = Hand::new(Model::Averaged, 1, Memory::default());
    hand.set_scene(scene);
    let (mut typist, _) = Typist::new(hand).expect("it prompts");
    assert_eq!(ask(&mut typist, "HI"), [0; 0]);
    typist
}

fn ball() -> Scene {
    grasp::parse("ball.toml", BALL, &[0.0; 7]).expect("a scene")
}

fn ask(typist: &mut Typist, line: &str) -> Vec<i32> {
    let received = typist.run_line(line).expect("it prompts");
    assert_eq!(received.status, 0, "{received:?}");
    received.answer.split_whitespace().map(|word| word.parse().expect("a number")).collect()
}

/// Gaps between each finger's link and tip and the ball, mm.
fn gaps(typist: &Typist) -> Vec<[f64; 2]> {
    let scene = typist.hand().scene().expect("a scene");
    let fingers = scene.fingers(&typist.hand().pose());
    let to_ball = |part| 1000.0 * gap(part, &scene.objects[0].capsule);
    fingers.iter().map(|[link, tip]| [to_ball(link), to_ball(tip)]).collect()
}

#[test]
fn grasp_links_lock_at_the_ball_and_tips_envelop_it() {
    let mut typist = in_scene(ball());
    assert!(gaps(&typist).iter().flatten().all(|&gap| gap > 10.0), "open");
    ask(&mut typist, "GC");
    for [link, tip] in gaps(&typist) {
        // Pressed in by a link's torque, under 1 mm at 2e5 N/m; it may spring back by one hall count, 0.3 mm at its lever.
        assert!((-1.0..=0.3).contains(&link), "the link is at the ball: {link} mm");
        assert!((-4.0..0.0).contains(&tip), "the tip presses on it: {tip} mm");
    }
    assert_eq!(ask(&mut typist, "GFGET BD"), [1; 3]);
    assert_eq!(
        ask(&mut typist, "GFGET BP"),
        ask(&mut typist, "GFGET P"),
        "the links are locked where they broke away"
    );
    let tips = ask(&mut typist, "X567FGET P");
    // Again with BS 1: the tips stay where the links stopped.
    let mut stopped = in_scene(ball());
    ask(&mut stopped, "GFSET BS 1");
    ask(&mut stopped, "GC");
    assert_eq!(ask(&mut stopped, "GFGET BD"), [1; 3]);
    for (went_on, stopped) in tips.iter().zip(ask(&mut stopped, "X567FGET P")) {
        // A position is good to one hall count.
        assert!(stopped <= went_on - 2 * 55, "{stopped} of {went_on}: two hall counts less at least");
    }
}

#[test]
fn grasp_with_x_moves_links_and_tips_independently() {
    let mut typist = in_scene(ball());
    ask(&mut typist, "X123567C");
    assert_eq!(ask(&mut typist, "GFGET BD"), [0; 3], "no breakaway");
    let (links, tips) = (ask(&mut typist, "GFGET P"), ask(&mut typist, "X567FGET P"));
    // Tips that go along turn a quarter as far as links.
    assert!(tips.iter().zip(&links).all(|(tip, link)| 2 * tip > *link), "{tips:?}, {links:?}");
    assert!(gaps(&typist).iter().all(|[_, tip]| *tip < 0.5), "and meet the ball by themselves");
}

#[test]
fn spread_closing_on_closed_fingers_stops_where_they_meet() {
    // With the fingers closed over the palm, fingers 1 and 2 meet finger 3 at its sides.
    let mut typist = in_scene(Scene::default());
    ask(&mut typist, "GC");
    ask(&mut typist, "SC");
    let met = ask(&mut typist, "SFGET P")[0];
    assert!(met < 8000, "the spread is stopped on its way: {met}");
    let fingers = typist.hand().scene().expect("a scene").fingers(&typist.hand().pose());
    let least = |a: usize| {
        let pairs = fingers[a].iter().flat_map(|part| fingers[2].iter().map(move |other| gap(part, other)));
        1000.0 * pairs.fold(f64::INFINITY, f64::min)
    };
    assert!(least(0) < 0.5 && least(1) < 0.5, "by finger 3: {} and {} mm", least(0), least(1));
    let mut alone = Typist::new(Hand::new(Model::Averaged, 1, Memory::default())).expect("it prompts").0;
    for line in ["HI", "GC", "SC"] {
        ask(&mut alone, line);
    }
    assert!(ask(&mut alone, "SFGET P")[0] > 9000, "nothing else stops it");
}
